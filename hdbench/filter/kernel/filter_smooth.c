/* Fixed-interval smoother: a forward pass that keeps a checkpoint per segment, then each segment
 * forwards again and backwards, the last one first. */
#include <string.h>

#include "filter_host.h"

#define HDB_RECORDS
#define HDB_LANES 1
#define HDB_CHUNK 64
#define HDB_FORM(name) hdb_smooth_##name
#include "filter_lanes.h"
#include "filter_recurse.h"
#include "filter_dispatch.h"

#ifdef HDB_MULTIVERSION
#define VERSIONED __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define VERSIONED
#endif

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

VERSIONED static void backward(int no, int nb, int length, const double *records,
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
    hdb_state s;
    adjoint a;
    for (size_t k = 0; k < n; ++k) {
        if (!(hdb_abs(in->time[k]) <= HDB_LARGEST) || (k > 0 && !(in->time[k] > in->time[k - 1]))) {
            *bad = k;
            return HDB_ERR_TIME;
        }
    }
    memset(scratch, 0, state_size * sizeof *scratch);
    hdb_smooth_load(nb, &s, scratch, 0);
    memset(&a, 0, sizeof a);
    for (size_t from = 0; from < n; from += 64) {
        if (from % SEGMENT == 0)
            hdb_smooth_store(nb, &s, scratch + from / SEGMENT * state_size, 0);
        forward(model, &s, n - from < 64 ? (int)(n - from) : 64, in, from, expected, NULL, NULL);
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
