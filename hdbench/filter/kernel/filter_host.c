/* Arrays of samples: one trace, many traces side by side, and the fixed-interval smoother. */
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
#pragma GCC push_options
#pragma GCC target("avx512f,avx512dq,avx512vl")
#define HDB_ISA(name) hdb_avx512_##name
#define HDB_VECTOR 8
#define HDB_PAIRS 1, 0, 3, 2, 5, 4, 7, 6
#define HDB_QUARTERS 2, 3, 0, 1, 6, 7, 4, 5
#define HDB_HALVES 4, 5, 6, 7, 0, 1, 2, 3
#include "filter_arrays.h"
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
#include "filter_arrays.h"
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
#include "filter_arrays.h"

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

/* Fixed-interval smoother: a forward pass that keeps a checkpoint per segment, then each segment
 * forwards again and backwards, the last one first. */
#define HDB_RECORDS
#define HDB_LANES 1
#define HDB_CHUNK 64
#define HDB_FORM(name) hdb_smooth_##name
#include "filter_motion.h"
#include "filter_recursion.h"

#define SEGMENT 256 /* samples between checkpoints; a multiple of the chunk */
#define N_MAX (2 * HDB_MAX_BLOCKS)

static int record_size(int nb) { return 2 * nb + nb * (2 * nb + 1) + 2; }

size_t hdb_smooth_scratch(const hdb_model *model, size_t n)
{
    const int nb = model->n_oscillators + model->n_slow;
    return (n / SEGMENT + 1) * (size_t)HDB_STATE_SIZE(nb) +
           SEGMENT * (size_t)(record_size(nb) + 4 * nb);
}

/* Filter m samples; keep what the backward pass needs, or nothing where records is NULL: each
 * prediction, and per block cosine and sine, or f11 f12 f21 f22. */
static void forward(const hdb_model *model, hdb_state *s, int m, const hdb_samples *in,
                    size_t from, double *expected, double *records, double *steps)
{
    const int no = model->n_oscillators, nb = no + model->n_slow;
    hdb_smooth_work k;
    for (int i = 0; i < m; ++i) {
        const size_t at = from + (size_t)i;
        hdb_smooth_observe(model, s, &k, i, in->time[at], in->velocity[at], in->torque[at],
                           in->angle == NULL ? NAN : in->angle[at]);
    }
    hdb_smooth_filter(model, s, m, &k, records);
    memcpy(expected + from, k.expected, (size_t)m * sizeof(double));
    for (int i = 0; records != NULL && i < m; ++i) {
        for (int j = 0; j < nb; ++j, steps += 4) {
            steps[0] = j < no ? k.cosine[j][i] : k.f[j - no][i][0];
            steps[1] = j < no ? k.sine[j][i] : k.f[j - no][i][1];
            steps[2] = j < no ? 0 : k.f[j - no][i][2];
            steps[3] = j < no ? 0 : k.f[j - no][i][3];
        }
    }
}

HDB_INLINE void unpack(int n, const double *packed, double (*p)[N_MAX])
{
    for (int i = 0; i < n; ++i)
        for (int j = 0; j <= i; ++j)
            p[i][j] = p[j][i] = *packed++;
}

/* v <- (I - K C)' v + C' e / S, m <- (I - K C)' m (I - K C) + C' C / S */
HDB_INLINE void unmeasure(int n, double (*p)[N_MAX], const double *c, double inverse, double e,
                          double *v, double (*m)[N_MAX])
{
    double gain[N_MAX], u[N_MAX], along = 0, twice = 0;
    for (int i = 0; i < n; ++i)
        gain[i] = u[i] = 0;
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i)
            gain[i] += p[j][i] * (c[j] * inverse);
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i)
            u[i] += m[j][i] * gain[j];
    for (int i = 0; i < n; ++i) {
        along += gain[i] * v[i];
        twice += gain[i] * u[i];
    }
    for (int i = 0; i < n; ++i) {
        v[i] += c[i] * (e * inverse - along);
        for (int j = 0; j < n; ++j)
            m[i][j] += c[i] * c[j] * (twice + inverse) - (c[i] * u[j] + c[j] * u[i]);
    }
}

/* v <- F' v, m <- F' m F for the slow blocks; F = I for the others. */
HDB_INLINE void unturn(int no, int nb, const double *f, double *v, double (*m)[N_MAX])
{
    for (int b = no; b < nb; ++b) {
        const double *const a = f + 4 * b;
        const int i = 2 * b, j = i + 1;
        const double v0 = v[i], v1 = v[j];
        v[i] = a[0] * v0 + a[2] * v1;
        v[j] = a[1] * v0 + a[3] * v1;
        for (int k = 0; k < 2 * nb; ++k) {
            const double m0 = m[i][k], m1 = m[j][k];
            m[i][k] = a[0] * m0 + a[2] * m1;
            m[j][k] = a[1] * m0 + a[3] * m1;
        }
        for (int k = 0; k < 2 * nb; ++k) {
            const double m0 = m[k][i], m1 = m[k][j];
            m[k][i] = m0 * a[0] + m1 * a[2];
            m[k][j] = m0 * a[1] + m1 * a[3];
        }
    }
}

/* z = z- + P- v; P = P- - P- m P-, of each block, in the axes of its torque: turned by f. */
HDB_INLINE void estimate(int no, int n, const double *z, double (*p)[N_MAX], const double *f,
                         const double *v, double (*m)[N_MAX], double *mean, double *covariance)
{
    double sum[N_MAX];
    for (int i = 0; i < n; ++i)
        sum[i] = z[i];
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i)
            sum[i] += p[j][i] * v[j];
    for (int i = 0; i < n; i += 2) {
        const double c = i < 2 * no ? f[2 * i] : 1, s = i < 2 * no ? f[2 * i + 1] : 0;
        mean[i] = c * sum[i] + s * sum[i + 1];
        mean[i + 1] = c * sum[i + 1] - s * sum[i];
        if (covariance == NULL)
            continue;
        double row[2][N_MAX], a[2][N_MAX], c11 = 0, c12 = 0, c22 = 0;
        for (int k = 0; k < n; ++k) {
            a[0][k] = c * p[i][k] + s * p[i + 1][k];
            a[1][k] = c * p[i + 1][k] - s * p[i][k];
            row[0][k] = row[1][k] = 0;
        }
        for (int j = 0; j < n; ++j) {
            for (int k = 0; k < n; ++k) {
                row[0][k] += a[0][j] * m[j][k];
                row[1][k] += a[1][j] * m[j][k];
            }
        }
        for (int k = 0; k < n; ++k) {
            c11 += row[0][k] * a[0][k];
            c12 += row[0][k] * a[1][k];
            c22 += row[1][k] * a[1][k];
        }
        covariance[3 * (i / 2)] = c * a[0][i] + s * a[0][i + 1] - c11;
        covariance[3 * (i / 2) + 1] = c * a[0][i + 1] - s * a[0][i] - c12;
        covariance[3 * (i / 2) + 2] = c * a[1][i + 1] - s * a[1][i] - c22;
    }
}

typedef struct { /* of the data after a sample */
    double v[N_MAX], m[N_MAX][N_MAX];
} adjoint;

HDB_INLINE void back(int no, int nb, int length, const double *records, const double *steps,
                     adjoint *a, double *mean, double *covariance)
{
    const int n = 2 * nb, size = record_size(nb);
    double p[N_MAX][N_MAX];
    for (int i = length - 1; i >= 0; --i) {
        const double *const record = records + (size_t)i * (size_t)size;
        const double *const f = steps + 4 * nb * i;
        const double inverse = record[size - 2], e = record[size - 1];
        double *const own = covariance == NULL ? NULL : covariance + 3 * nb * i;
        double c[N_MAX];
        if (!(inverse >= 0)) { /* not started */
            for (int j = 0; j < n; ++j)
                mean[n * i + j] = NAN;
            for (int j = 0; own != NULL && j < 3 * nb; ++j)
                own[j] = NAN;
            continue;
        }
        for (int b = 0; b < nb; ++b) {
            c[2 * b] = b < no ? f[4 * b] : 1;
            c[2 * b + 1] = b < no ? f[4 * b + 1] : 0;
        }
        unpack(n, record + n, p);
        if (inverse > 0)
            unmeasure(n, p, c, inverse, e, a->v, a->m);
        estimate(no, n, record, p, f, a->v, a->m, mean + n * i, own);
        unturn(no, nb, f, a->v, a->m);
    }
}

static void backward(int no, int nb, int length, const double *records,
                     const double *steps, adjoint *a, double *mean, double *covariance)
{
    switch (nb) {
    case 2: back(no, 2, length, records, steps, a, mean, covariance); break;
    case 3: back(no, 3, length, records, steps, a, mean, covariance); break;
    case 4: back(no, 4, length, records, steps, a, mean, covariance); break;
    default: back(no, nb, length, records, steps, a, mean, covariance); break;
    }
}

hdb_status hdb_filter_smooth(const hdb_model *model, size_t n, const hdb_samples *in,
                             double *expected, double *mean, double *covariance, double *scratch,
                             size_t *bad)
{
    const int nb = model->n_oscillators + model->n_slow;
    const size_t state_size = (size_t)HDB_STATE_SIZE(nb);
    double *const records = scratch + (n / SEGMENT + 1) * state_size;
    double *const steps = records + SEGMENT * (size_t)record_size(nb);
    double state[HDB_STATE_SIZE(HDB_MAX_BLOCKS)] = {0}, unread[6][SEGMENT], sums[3];
    uint8_t flag[SEGMENT];
    hdb_state s;
    adjoint a;
    const hdb_status status = check_time(state, n, in->time, bad);
    if (status != HDB_OK)
        return status;
    memset(&a, 0, sizeof a);
    for (size_t from = 0; from < n; from += SEGMENT) {
        const hdb_samples part = {in->time + from, in->velocity + from, in->torque + from,
                                  in->angle == NULL ? NULL : in->angle + from};
        const hdb_outputs out = {expected + from, unread[0], unread[1], unread[2], unread[3],
                                 unread[4], unread[5], flag};
        memcpy(scratch + from / SEGMENT * state_size, state, state_size * sizeof *state);
        (void)hdb_filter_run(model, state, n - from < SEGMENT ? n - from : SEGMENT, &part, &out,
                             sums, bad);
    }
    for (size_t segment = (n + SEGMENT - 1) / SEGMENT; segment-- > 0;) {
        const size_t start = segment * SEGMENT, end = n - start < SEGMENT ? n : start + SEGMENT;
        hdb_smooth_load(nb, &s, scratch + segment * state_size, 0);
        for (size_t from = start; from < end; from += 64)
            forward(model, &s, end - from < 64 ? (int)(end - from) : 64, in, from, expected,
                    records + (from - start) * (size_t)record_size(nb),
                    steps + (from - start) * 4 * (size_t)nb);
        backward(model->n_oscillators, nb, (int)(end - start), records, steps, &a,
                 mean + start * 2 * (size_t)nb,
                 covariance == NULL ? NULL : covariance + start * 3 * (size_t)nb);
    }
    return HDB_OK;
}
