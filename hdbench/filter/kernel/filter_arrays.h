/* Chunks of one trace, and of HDB_VECTOR traces side by side. A template: define HDB_ISA(name), and HDB_VECTOR,
 * the doubles of a vector register (1: the compiler has none), before each inclusion. */
#define HDB_SUMS
#define HDB_COASTS
#define HDB_DIRECT
#define HDB_LANES 1
#define HDB_CHUNK HDB_RUN_CHUNK
#define HDB_FORM(name) HDB_ISA(run_##name)
#include "filter_motion.h"
#if HDB_VECTOR > 1
#define HDB_ROWS(name) HDB_ISA(run_few_##name)
#define HDB_SLOTS 3
#define HDB_SLOW_SLOTS 0
#include "filter_rows.h"
#undef HDB_ROWS
#undef HDB_SLOW_SLOTS
#define HDB_ROWS(name) HDB_ISA(run_more_##name)
#define HDB_SLOW_SLOTS 2
#include "filter_rows.h"
#undef HDB_ROWS
#undef HDB_SLOW_SLOTS
#undef HDB_SLOTS
#endif
#include "filter_recursion.h"
#undef HDB_LANES
#undef HDB_CHUNK
#undef HDB_FORM

#undef HDB_SUMS
#undef HDB_COASTS
#undef HDB_DIRECT

/* P in rows, once a chunk starts with a started filter of few blocks. */
typedef struct {
#if HDB_VECTOR > 1
    HDB_ISA(run_few_filter) few;
    HDB_ISA(run_more_filter) more;
    HDB_ISA(run_few_table) few_table;
    HDB_ISA(run_more_table) more_table;
#endif
    int as_few, as_more;
} HDB_ISA(run_rows);

#if HDB_VECTOR > 1
static int HDB_ISA(run_by_rows)(const hdb_model *model, HDB_ISA(run_lanes) *s,
                                HDB_ISA(run_rows) *rows, int m, HDB_ISA(run_work) *k)
{
    const int ns = model->n_slow, begun = rows->as_few || rows->as_more;
    if (model->n_oscillators > 3 || ns > 2 || !(s->head[HDB_STARTED] > 0))
        return 0;
    if (!begun && ns == 0)
        HDB_ISA(run_few_unpack)(model, s, &rows->few, &rows->few_table);
    else if (!begun)
        HDB_ISA(run_more_unpack)(model, s, &rows->more, &rows->more_table);
    rows->as_few = ns == 0;
    rows->as_more = ns > 0;
    if (model->n_oscillators == 3) /* in registers */
        HDB_ISA(run_turn)(3, ns, model, s, m, k);
    else
        HDB_ISA(run_turn)(model->n_oscillators, ns, model, s, m, k);
    if (rows->as_few)
        HDB_ISA(run_few_recurse)(model, s, &rows->few, &rows->few_table, m, k);
    else
        HDB_ISA(run_more_recurse)(model, s, &rows->more, &rows->more_table, m, k);
    return 1;
}

static void HDB_ISA(run_pack)(const hdb_model *model, const HDB_ISA(run_rows) *rows,
                              HDB_ISA(run_lanes) *s)
{
    if (rows->as_few)
        HDB_ISA(run_few_pack)(model, &rows->few, s);
    if (rows->as_more)
        HDB_ISA(run_more_pack)(model, &rows->more, s);
}
#else
static int HDB_ISA(run_by_rows)(const hdb_model *model, HDB_ISA(run_lanes) *s,
                                HDB_ISA(run_rows) *rows, int m, HDB_ISA(run_work) *k)
{
    (void)model, (void)s, (void)rows, (void)m, (void)k;
    return 0;
}

static void HDB_ISA(run_pack)(const hdb_model *model, const HDB_ISA(run_rows) *rows,
                              HDB_ISA(run_lanes) *s)
{
    (void)model, (void)rows, (void)s;
}
#endif

static void HDB_ISA(run_observe_chunk)(const hdb_model *model, HDB_ISA(run_lanes) *s, int m,
                                       const hdb_samples *in, size_t from, HDB_ISA(run_work) *k)
{
    const double *const angle = in->angle == NULL ? NULL : in->angle + from;
    if (HDB_ISA(run_observe_all)(model, s, k, m, in->time + from, in->velocity + from,
                                 in->torque + from, angle))
        return;
    for (int i = 0; i < m; ++i) {
        const size_t at = from + (size_t)i;
        HDB_ISA(run_observe)(model, s, k, i, in->time[at], in->velocity[at], in->torque[at],
                             angle == NULL ? NAN : angle[i]);
    }
}

static void HDB_ISA(run_chunk)(const hdb_model *model, HDB_ISA(run_lanes) *s,
                               HDB_ISA(run_rows) *rows, int m, const hdb_samples *in,
                               const hdb_outputs *out, size_t from)
{
    HDB_ISA(run_work) k;
    k.expected = out->expected + from;
    k.part[HDB_RIPPLE] = out->ripple + from;
    k.part[HDB_MISALIGNMENT] = out->misalignment + from;
    k.part[HDB_SLOW] = out->slow + from;
    k.filtered = out->filtered + from;
    k.innovation = out->innovation + from;
    k.variance = out->variance + from;
    HDB_ISA(run_observe_chunk)(model, s, m, in, from, &k);
    if (!HDB_ISA(run_by_rows)(model, s, rows, m, &k))
        HDB_ISA(run_filter)(model, s, m, &k, NULL);
    for (int i = 0; i < m; ++i) { /* the last byte of a sum with a large number */
        const double shifted = k.flag[i] + HDB_BIAS;
        hdb_bits bits;
        memcpy(&bits, &shifted, sizeof bits);
        out->flag[from + (size_t)i] = (uint8_t)bits;
    }
}

static void HDB_ISA(run)(const hdb_model *model, double *state, size_t n, const hdb_samples *in,
                         const hdb_outputs *out, double *sums)
{
    const int nb = model->n_oscillators + model->n_slow;
    HDB_ISA(run_lanes) s;
    HDB_ISA(run_rows) rows;
    rows.as_few = rows.as_more = 0;
    HDB_ISA(run_load)(nb, &s, state, 0);
    for (size_t from = 0; from < n; from += HDB_RUN_CHUNK) {
        const int m = n - from < HDB_RUN_CHUNK ? (int)(n - from) : HDB_RUN_CHUNK;
        HDB_ISA(run_chunk)(model, &s, &rows, m, in, out, from);
    }
    HDB_ISA(run_pack)(model, &rows, &s);
    HDB_ISA(run_store)(nb, &s, state, 0);
    sums[0] = s.used;
    sums[1] = s.log_sum + log(s.product);
    sums[2] = s.squares;
}

/* Many traces. */
#define HDB_SUMS
#define HDB_UNFLAGGED
#define HDB_COASTS
#define HDB_UNROLLED
#define HDB_LANES HDB_VECTOR
#define HDB_CHUNK HDB_BATCH_CHUNK
#define HDB_FORM(name) HDB_ISA(batch_##name)
#include "filter_motion.h"
#include "filter_recursion.h"
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
