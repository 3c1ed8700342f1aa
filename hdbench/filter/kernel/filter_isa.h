/* Chunks of one trace and of HDB_VECTOR traces, for one width of vectors. A template: define
 * HDB_ISA(name), and HDB_VECTOR, the doubles of a vector register, before each inclusion. */
#define HDB_SUMS
#define HDB_LANES 1
#define HDB_CHUNK HDB_RUN_CHUNK
#define HDB_FORM(name) HDB_ISA(run_##name)
#include "filter_lanes.h"
#define HDB_SHAPE(name) HDB_ISA(run_triangle_##name)
#include "filter_recurse.h"
#undef HDB_SHAPE
#define HDB_MANY(name) HDB_ISA(run_triangle_##name)
#if HDB_VECTOR > 1
#define HDB_ROWS
#define HDB_ROW_STATES 8
#define HDB_SHAPE(name) HDB_ISA(run_rows_##name)
#include "filter_recurse.h"
#undef HDB_SHAPE
#undef HDB_ROWS
#undef HDB_ROW_STATES
#define HDB_FEW(name) HDB_ISA(run_rows_##name)
#else
#define HDB_FEW(name) HDB_ISA(run_triangle_##name)
#endif
#include "filter_dispatch.h"
#undef HDB_LANES
#undef HDB_CHUNK
#undef HDB_FORM
#undef HDB_FEW
#undef HDB_MANY

#define HDB_LANES HDB_VECTOR
#define HDB_CHUNK HDB_BATCH_CHUNK
#define HDB_FORM(name) HDB_ISA(batch_##name)
#define HDB_SHAPE(name) HDB_ISA(batch_triangle_##name)
#define HDB_FEW HDB_SHAPE
#define HDB_MANY HDB_SHAPE
#include "filter_lanes.h"
#include "filter_recurse.h"
#include "filter_dispatch.h"
#undef HDB_LANES
#undef HDB_CHUNK
#undef HDB_FORM
#undef HDB_SHAPE
#undef HDB_FEW
#undef HDB_MANY
#undef HDB_SUMS

static void HDB_ISA(run_chunk)(const hdb_model *model, HDB_ISA(run_lanes) *s, int m,
                               const hdb_samples *in, const hdb_outputs *out, size_t from)
{
    HDB_ISA(run_work) k;
    const size_t bytes = (size_t)m * sizeof(double);
    for (int i = 0; i < m; ++i) {
        const size_t at = from + (size_t)i;
        HDB_ISA(run_observe)(model, s, &k, i, in->time[at], in->velocity[at], in->torque[at],
                        in->angle == NULL ? NAN : in->angle[at]);
    }
    HDB_ISA(run_filter)(model, s, m, &k, NULL);
    memcpy(out->expected + from, k.expected, bytes);
    memcpy(out->ripple + from, k.part[HDB_RIPPLE], bytes);
    memcpy(out->misalignment + from, k.part[HDB_MISALIGNMENT], bytes);
    memcpy(out->slow + from, k.part[HDB_SLOW], bytes);
    memcpy(out->filtered + from, k.filtered, bytes);
    memcpy(out->innovation + from, k.innovation, bytes);
    memcpy(out->variance + from, k.variance, bytes);
    for (int i = 0; i < m; ++i)
        out->flag[from + (size_t)i] = (uint8_t)k.flag[i];
}

static void HDB_ISA(run)(const hdb_model *model, double *state, size_t n, const hdb_samples *in,
                         const hdb_outputs *out, double *sums)
{
    const int nb = model->n_oscillators + model->n_slow;
    HDB_ISA(run_lanes) s;
    HDB_ISA(run_load)(nb, &s, state, 0);
    for (size_t from = 0; from < n; from += HDB_RUN_CHUNK)
        HDB_ISA(run_chunk)(model, &s, n - from < HDB_RUN_CHUNK ? (int)(n - from) : HDB_RUN_CHUNK,
                           in, out, from);
    HDB_ISA(run_store)(nb, &s, state, 0);
    sums[0] = s.used;
    sums[1] = s.log_sum + log(s.product);
    sums[2] = s.squares;
}

/* m samples of up to HDB_VECTOR traces, `stride` columns apart in time. */
static void HDB_ISA(batch_chunk)(const hdb_model *model, HDB_ISA(batch_lanes) *s, int m,
                                  const hdb_samples *in, const hdb_outputs *out, size_t from,
                                  size_t stride, int live)
{
    enum { L = HDB_VECTOR };
    const size_t bytes = (size_t)live * sizeof(double);
    HDB_ISA(batch_work) k;
    for (int i = 0; i < m; ++i) { /* idle lanes see nothing */
        const size_t at = (from + (size_t)i) * stride;
        HDB_ISA(batch_number) velocity = {0}, torque = {0}, angle = velocity + NAN;
        memcpy(&velocity, in->velocity + at, live == L ? sizeof velocity : bytes);
        memcpy(&torque, in->torque + at, live == L ? sizeof torque : bytes);
        if (in->angle != NULL)
            memcpy(&angle, in->angle + at, live == L ? sizeof angle : bytes);
        const HDB_ISA(batch_number) none = {0}, time = none + in->time[from + (size_t)i];
        HDB_ISA(batch_observe)(model, s, &k, i, time, velocity, torque, angle);
    }
    HDB_ISA(batch_filter)(model, s, m, &k, NULL);
    for (int i = 0; i < m; ++i) {
        const size_t at = (from + (size_t)i) * stride;
        memcpy(out->filtered + at, &k.filtered[i], live == L ? sizeof k.filtered[i] : bytes);
        if (out->innovation != NULL) {
            memcpy(out->innovation + at, &k.innovation[i], bytes);
            memcpy(out->variance + at, &k.variance[i], bytes);
        }
    }
}

static void HDB_ISA(batch)(const hdb_model *model, size_t n, size_t n_traces,
                           const hdb_samples *in, const hdb_outputs *out, double *sums)
{
    static const double unseen[HDB_STATE_SIZE(HDB_MAX_BLOCKS)];
    for (size_t first = 0; first < n_traces; first += HDB_VECTOR) {
        const size_t left = n_traces - first;
        const int live = left < HDB_VECTOR ? (int)left : HDB_VECTOR;
        const hdb_samples own = {in->time, in->velocity + first, in->torque + first,
                                 in->angle == NULL ? NULL : in->angle + first};
        hdb_outputs mine = {.filtered = out->filtered + first};
        if (out->innovation != NULL) {
            mine.innovation = out->innovation + first;
            mine.variance = out->variance + first;
        }
        HDB_ISA(batch_lanes) s;
        for (int l = 0; l < HDB_VECTOR; ++l)
            HDB_ISA(batch_load)(model->n_oscillators + model->n_slow, &s, unseen, l);
        for (size_t from = 0; from < n; from += HDB_BATCH_CHUNK)
            HDB_ISA(batch_chunk)(model, &s,
                                 n - from < HDB_BATCH_CHUNK ? (int)(n - from) : HDB_BATCH_CHUNK,
                                 &own, &mine, from, n_traces, live);
        for (int l = 0; l < live; ++l) {
            const size_t at = first + (size_t)l;
            sums[at] = HDB_LANE(s.used, l);
            sums[n_traces + at] = HDB_LANE(s.log_sum, l) + log(HDB_LANE(s.product, l));
            sums[2 * n_traces + at] = HDB_LANE(s.squares, l);
        }
    }
}
