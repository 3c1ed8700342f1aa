/* Arrays of samples of one trace, and of many traces side by side. */
#include <string.h>

#include "filter_host.h"
#include "filter_math.h"

#define HDB_RUN_CHUNK 64 /* samples whose sines are computed together; changes speed only */
#define HDB_BATCH_CHUNK 8
#define HDB_BATCH_GROUPS 4 /* vectors of traces that go on by turns */
#define HDB_LANE(value, l) (((double *)&(value))[l])
#ifdef __GNUC__
#define HDB_LIKELY(x) __builtin_expect(x, 1)
#define HDB_RARELY(x) __builtin_expect(x, 0)
#define HDB_FETCH(at, writes) __builtin_prefetch(at, writes)
typedef double hdb_two __attribute__((vector_size(16)));
#ifdef __clang__ /* lanes change places */
#define HDB_MOVED(x, ...) __builtin_shufflevector(x, x, __VA_ARGS__)
#else
#define HDB_MOVED(x, ...) __builtin_shuffle(x, (HDB_ROWS(index)){__VA_ARGS__})
#endif
#else
#define HDB_FETCH(at, writes) (void)(at)
#endif

#ifdef HDB_MULTIVERSION /* GCC on x86-64: one version per width of its vectors */
#include <immintrin.h>
#pragma GCC push_options
#pragma GCC target("avx512f,avx512dq,avx512vl")
#define HDB_ISA(name) hdb_avx512_##name
#define HDB_VECTOR 8
#define HDB_PAIRS 1, 0, 3, 2, 5, 4, 7, 6
#define HDB_QUARTERS 2, 3, 0, 1, 6, 7, 4, 5
#define HDB_HALVES 4, 5, 6, 7, 0, 1, 2, 3
#include "filter_one.h"
#include "filter_many.h"
#undef HDB_ISA
#undef HDB_VECTOR
#undef HDB_PAIRS
#undef HDB_QUARTERS
#undef HDB_HALVES
#pragma GCC pop_options
#pragma GCC push_options
#pragma GCC target("avx2")
#define HDB_ISA(name) hdb_avx2_##name
#define HDB_VECTOR 4
#define HDB_PAIRS 1, 0, 3, 2
#define HDB_HALVES 2, 3, 0, 1
#include "filter_one.h"
#include "filter_many.h"
#undef HDB_ISA
#undef HDB_VECTOR
#undef HDB_PAIRS
#undef HDB_HALVES
#pragma GCC pop_options
#endif

#define HDB_ISA(name) hdb_plain_##name
#ifdef __GNUC__
#define HDB_VECTOR 2 /* two doubles: what every 64-bit processor has */
#define HDB_PAIRS 1, 0
#else
#define HDB_VECTOR 1
#endif
#include "filter_one.h"
#include "filter_many.h"

hdb_status hdb_model_read(hdb_model *model, const double *a, size_t size)
{
    if (size < HDB_MODEL_HEADER || !(a[0] >= 0 && a[1] >= 0 && a[0] + a[1] <= HDB_MAX_BLOCKS))
        return HDB_ERR_CONFIG;
    const size_t nb = (size_t)a[0] + (size_t)a[1];
    if (size != HDB_MODEL_HEADER + HDB_MODEL_BLOCK * nb)
        return HDB_ERR_CONFIG;
    *model = (hdb_model){.n_oscillators = (int)a[0], .n_slow = (int)a[1], .r = a[2],
                         .inertia = a[3], .ratio = a[4], .constant = a[5], .gate = a[6],
                         .gate_samples = a[7], .prior_start = a[8] != 0};
    for (size_t i = 0; i < nb; ++i) {
        const double *const b = a + HDB_MODEL_HEADER + HDB_MODEL_BLOCK * i;
        model->block[i] = (hdb_block){.kind = (int)b[0], .part = (int)b[1], .order = b[2],
                                      .omega = b[3], .q_sample = b[4], .q_rad = b[5],
                                      .q_s = b[6], .rate = b[7], .variance = b[8],
                                      .prior = {b[9], b[10]}};
    }
    return hdb_model_check(model);
}

static hdb_status check_time(const double *state, size_t n, const double *time, size_t *bad)
{
    /* times that increase are finite where the first and the last are */
    int later = n > 0 && hdb_abs(time[0]) <= HDB_LARGEST && hdb_abs(time[n - 1]) <= HDB_LARGEST &&
                (!(state[HDB_SEEN] > 0) || time[0] > state[HDB_TIME]);
    for (size_t k = 1; k < n; ++k)
        later &= time[k] > time[k - 1];
    for (size_t k = 0; k < n && !later; ++k) {
        const int first = k == 0 && !(state[HDB_SEEN] > 0);
        const double before = k > 0 ? time[k - 1] : state[HDB_TIME];
        if (!(hdb_abs(time[k]) <= HDB_LARGEST) || !(first || time[k] > before)) {
            *bad = k;
            return HDB_ERR_TIME;
        }
    }
    return HDB_OK;
}

#ifdef HDB_MULTIVERSION
static int hdb_has_avx512(void)
{
    return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
           __builtin_cpu_supports("avx512vl");
}
#endif

hdb_status hdb_filter_run(const hdb_model *model, double *state, size_t n, const hdb_samples *in,
                          const hdb_outputs *out, double *sums, size_t *bad)
{
    const hdb_status status = check_time(state, n, in->time, bad);
    if (status != HDB_OK)
        return status;
#ifdef HDB_MULTIVERSION
    if (hdb_has_avx512())
        hdb_avx512_run(model, state, n, in, out, sums);
    else if (__builtin_cpu_supports("avx2"))
        hdb_avx2_run(model, state, n, in, out, sums);
    else
#endif
        hdb_plain_run(model, state, n, in, out, sums);
    return HDB_OK;
}

hdb_status hdb_filter_batch(const hdb_model *model, size_t n, size_t n_traces,
                            const hdb_samples *in, const hdb_outputs *out, double *sums,
                            size_t *bad)
{
    const double unseen[HDB_HEADER] = {0};
    const hdb_status status = check_time(unseen, n, in->time, bad);
    if (status != HDB_OK)
        return status;
#ifdef HDB_MULTIVERSION
    if (hdb_has_avx512())
        hdb_avx512_batch(model, n, n_traces, in, out, sums);
    else if (__builtin_cpu_supports("avx2"))
        hdb_avx2_batch(model, n, n_traces, in, out, sums);
    else
#endif
        hdb_plain_batch(model, n, n_traces, in, out, sums);
    return HDB_OK;
}
