/* Chunks of one trace, for one width of vectors. A template: define HDB_ISA(name), and HDB_VECTOR,
 * the doubles of a vector register (1: the compiler has none), before each inclusion. */
#define HDB_SUMS
#define HDB_COASTS
#define HDB_DIRECT
#define HDB_LANES 1
#define HDB_CHUNK HDB_RUN_CHUNK
#define HDB_FORM(name) HDB_ISA(run_##name)
#include "filter_lanes.h"
#include "filter_recurse.h"
#if HDB_VECTOR > 1
#define HDB_ROWS(name) HDB_ISA(run_few_##name)
#define HDB_SLOTS 3
#define HDB_SLOW_SLOTS 0
#if HDB_VECTOR == 8
#define HDB_TRIANGLE                                                                              \
    {{-1, 1, 2, 3, 4, 5},   {8, -1, 10, 11, 12, 13}, {2, 10, -1, 0, 6, 7},                        \
     {3, 11, 0, -1, 9, 14}, {4, 12, 6, 9, -1, 15},   {5, 13, 7, 14, 15, -1}}
#endif
#include "filter_rows.h"
#undef HDB_TRIANGLE
#undef HDB_ROWS
#undef HDB_SLOW_SLOTS
#define HDB_ROWS(name) HDB_ISA(run_more_##name)
#define HDB_SLOW_SLOTS 2
#include "filter_rows.h"
#undef HDB_ROWS
#undef HDB_SLOW_SLOTS
#undef HDB_SLOTS
#endif
#include "filter_dispatch.h"
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
