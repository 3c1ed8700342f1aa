/* Chunks of HDB_VECTOR traces side by side. A template, as filter_one.h. */
#define HDB_SUMS
#define HDB_UNFLAGGED
#define HDB_COASTS
#define HDB_UNROLLED
#define HDB_LANES HDB_VECTOR
#define HDB_CHUNK HDB_BATCH_CHUNK
#define HDB_FORM(name) HDB_ISA(batch_##name)
#include "filter_lanes.h"
#include "filter_recurse.h"
#include "filter_dispatch.h"
#undef HDB_LANES
#undef HDB_CHUNK
#undef HDB_FORM
#undef HDB_UNROLLED
#undef HDB_SUMS
#undef HDB_UNFLAGGED
#undef HDB_COASTS

/* m samples of up to HDB_VECTOR traces, `stride` columns apart in time. */
static void HDB_ISA(batch_chunk)(const hdb_model *model, HDB_ISA(batch_lanes) *s, int m,
                                  const hdb_samples *in, const hdb_outputs *out, size_t from,
                                  size_t stride, int live)
{
    enum { L = HDB_VECTOR };
    const size_t bytes = (size_t)live * sizeof(double);
    HDB_ISA(batch_work) k;
    HDB_ISA(batch_number) velocity[HDB_BATCH_CHUNK], torque[HDB_BATCH_CHUNK];
    HDB_ISA(batch_number) angle[HDB_BATCH_CHUNK];
    const HDB_ISA(batch_number) none = {0};
    for (int i = 0; i < m; ++i) { /* idle lanes see zeros */
        const size_t at = (from + (size_t)i) * stride;
        velocity[i] = torque[i] = none;
        angle[i] = in->angle == NULL ? none + NAN : none;
        memcpy(&velocity[i], in->velocity + at, live == L ? sizeof *velocity : bytes);
        memcpy(&torque[i], in->torque + at, live == L ? sizeof *torque : bytes);
        if (in->angle != NULL)
            memcpy(&angle[i], in->angle + at, live == L ? sizeof *angle : bytes);
    }
    if (!HDB_ISA(batch_observe_all)(model, s, &k, m, in->time + from, velocity, torque,
                                    in->angle == NULL ? NULL : angle))
        for (int i = 0; i < m; ++i)
            HDB_ISA(batch_observe)(model, s, &k, i, none + in->time[from + (size_t)i],
                                   velocity[i], torque[i], angle[i]);
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
