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

/* Ask for the rows of the next m samples, while those of this chunk are filtered. */
static void HDB_ISA(batch_fetch)(const hdb_samples *in, const hdb_outputs *out, size_t from, int m,
                                 size_t stride)
{
    for (size_t at = from * stride; m > 0; --m, at += stride) {
        HDB_FETCH(in->velocity + at, 0);
        HDB_FETCH(in->torque + at, 0);
        HDB_FETCH(out->filtered + at, 1);
    }
}

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

/* Columns from `first` on, as many as HDB_BATCH_GROUPS vectors hold: chunk after chunk of all of
 * them, so that rows of the arrays are read and written in long pieces. */
static void HDB_ISA(batch_columns)(const hdb_model *model, size_t n, size_t n_traces, size_t first,
                                   const hdb_samples *in, const hdb_outputs *out, double *sums)
{
    static const double unseen[HDB_STATE_SIZE(HDB_MAX_BLOCKS)];
    enum { L = HDB_VECTOR };
    HDB_ISA(batch_lanes) s[HDB_BATCH_GROUPS];
    const size_t left = n_traces - first;
    const size_t count = left < HDB_BATCH_GROUPS * L ? left : HDB_BATCH_GROUPS * L;
    for (size_t j = 0; j < HDB_BATCH_GROUPS * L; ++j)
        HDB_ISA(batch_load)(model->n_oscillators + model->n_slow, &s[j / L], unseen, (int)(j % L));
    for (size_t from = 0; from < n; from += HDB_BATCH_CHUNK) {
        const int m = n - from < HDB_BATCH_CHUNK ? (int)(n - from) : HDB_BATCH_CHUNK;
        for (size_t j = 0; j < count; j += L) {
            const size_t at = first + j;
            const hdb_samples own = {in->time, in->velocity + at, in->torque + at,
                                     in->angle == NULL ? NULL : in->angle + at};
            hdb_outputs mine = {.filtered = out->filtered + at};
            if (out->innovation != NULL) {
                mine.innovation = out->innovation + at;
                mine.variance = out->variance + at;
            }
            const size_t next = from + (size_t)m;
            const int ahead = n - next < HDB_BATCH_CHUNK ? (int)(n - next) : HDB_BATCH_CHUNK;
            HDB_ISA(batch_fetch)(&own, &mine, next, ahead, n_traces);
            HDB_ISA(batch_chunk)(model, &s[j / L], m, &own, &mine, from, n_traces,
                                 count - j < L ? (int)(count - j) : L);
        }
    }
    for (size_t j = 0; j < count; ++j) {
        const HDB_ISA(batch_lanes) *const own = &s[j / L];
        const size_t at = first + j, l = j % L;
        sums[at] = HDB_LANE(own->used, l);
        sums[n_traces + at] = HDB_LANE(own->log_sum, l) + log(HDB_LANE(own->product, l));
        sums[2 * n_traces + at] = HDB_LANE(own->squares, l);
    }
}

static void HDB_ISA(batch)(const hdb_model *model, size_t n, size_t n_traces,
                           const hdb_samples *in, const hdb_outputs *out, double *sums)
{
    for (size_t first = 0; first < n_traces; first += HDB_BATCH_GROUPS * HDB_VECTOR)
        HDB_ISA(batch_columns)(model, n, n_traces, first, in, out, sums);
}
