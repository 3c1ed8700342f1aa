/* Motion and transitions, HDB_CHUNK samples at a time. A template: define before each inclusion
 *   HDB_FORM(name)  its names,
 *   HDB_LANES       1, or the number of traces side by side in a vector of the compiler.
 * A lane's numbers depend neither on the other lanes nor on the length of a chunk. */
#include "filter_math.h"

#define L HDB_LANES
#define STATES (2 * HDB_MAX_BLOCKS)
#define AT(i, j) ((i) * ((i) + 1) / 2 + (j)) /* of P's lower triangle, j <= i */
#define EACH_LANE for (int l = 0; l < L; ++l)

#if HDB_LANES == 1
#define LANE(value, l) (value)
typedef hdb_real HDB_FORM(number);
typedef int HDB_FORM(mask);
#define PICK(which, one, other) ((which) ? (one) : (other))
#define ANY(which) (which)
#define HDB_NOT(which) (!(which))
#else
#define LANE(value, l) (((hdb_real *)&(value))[l])
typedef hdb_real HDB_FORM(number) __attribute__((vector_size(L * sizeof(hdb_real))));
typedef int64_t HDB_FORM(mask) __attribute__((vector_size(L * sizeof(hdb_real))));
typedef hdb_bits HDB_FORM(word) __attribute__((vector_size(L * sizeof(hdb_real))));
#define PICK(which, one, other)                                                                   \
    ((number)(((mask)(one) & (which)) | ((mask)(other) & ~(which))))
#define ANY(which) HDB_FORM(any)(which)
#define HDB_NOT(which) (~(which))
#endif
#define number HDB_FORM(number)
#define mask HDB_FORM(mask)
#define lanes HDB_FORM(lanes)
#define work HDB_FORM(work)

#ifdef HDB_SUMS
typedef struct {
    number head[HDB_HEADER], psi[HDB_MAX_BLOCKS], left[HDB_MAX_BLOCKS];
    number z[STATES], p[AT(STATES, 0)], g[STATES];
    number used, product, log_sum, squares;
    int since; /* samples since the product was looked at */
    int waiting; /* whether a lane may not have started */
} lanes;
#else
typedef hdb_state lanes;
#endif

typedef struct { /* one chunk */
    number turn[HDB_CHUNK], dt[HDB_CHUNK], torque[HDB_CHUNK], residual[HDB_CHUNK];
    number psi[HDB_MAX_BLOCKS][HDB_CHUNK], noise[HDB_MAX_BLOCKS][HDB_CHUNK];
    number cosine[HDB_MAX_BLOCKS][HDB_CHUNK], sine[HDB_MAX_BLOCKS][HDB_CHUNK];
    hdb_real f[HDB_MAX_SLOW][HDB_CHUNK][7]; /* of slow torques; all lanes share the time */
    number flag[HDB_CHUNK];
#ifdef HDB_DIRECT /* into the arrays of the caller */
    number *expected, *part[3], *filtered, *innovation, *variance;
#else
    number expected[HDB_CHUNK], part[3][HDB_CHUNK], filtered[HDB_CHUNK];
    number innovation[HDB_CHUNK], variance[HDB_CHUNK];
#endif
#ifdef HDB_COASTS
    int coasting; /* nothing is missing: acceleration = push + carry * last acceleration */
    number push[HDB_CHUNK];
    hdb_real carry[HDB_CHUNK];
#endif
} work;

#if HDB_LANES > 1
HDB_INLINE int HDB_FORM(any)(mask which)
{
    int64_t found = 0;
    EACH_LANE found |= which[l];
    return found != 0;
}
#endif

#if HDB_LANES == 1
HDB_INLINE number HDB_FORM(abs)(number value) { return hdb_abs(value); }
#else
HDB_INLINE number HDB_FORM(abs)(number value)
{
    const mask sign = (mask)(number){0} + INT64_MIN;
    return (number)((mask)value & ~sign);
}
#endif

HDB_INLINE mask HDB_FORM(usable)(number value) { return HDB_FORM(abs)(value) <= K(HDB_USABLE); }

HDB_INLINE number HDB_FORM(nearest)(number value) { return (value + HDB_BIAS) - HDB_BIAS; }

#include "filter_motion.h"

#if HDB_LANES == 1
#define SINCOS hdb_sincos
#else
#define SINCOS HDB_FORM(sincos)
#define HDB_SINCOS SINCOS
#define HDB_SINCOS_BITS HDB_FORM(bits)
#define HDB_NUMBER number
#define HDB_WORD HDB_FORM(word)
#include "filter_sincos.h"
#endif

#include "filter_phase.h"

/* Process noise of every oscillator. */
HDB_INLINE void HDB_FORM(stir)(int no, const hdb_model *model, int n, work *k)
{
    for (int j = 0; j < no; ++j) {
        const hdb_block *const b = &model->block[j];
        for (int i = 0; i < n; ++i) { /* what the model has not is left out, not multiplied by 0 */
            number noise = (number){0} + b->q_sample;
            if (b->q_rad > 0)
                noise += b->q_rad * HDB_FORM(abs)(k->turn[i]);
            if (b->q_s > 0)
                noise += b->q_s * k->dt[i];
            k->noise[j][i] = noise;
        }
    }
}

/* Cosine and sine of every oscillator, transition of every slow torque. */
HDB_INLINE void HDB_FORM(turn)(int no, int ns, const hdb_model *model, lanes *s, int n, work *k)
{
    int half[HDB_MAX_BLOCKS];
    HDB_UNROLL_FIXED
    for (int j = 0; j < no; ++j) {
        half[j] = hdb_half(model, j);
        if (half[j] < 0)
            HDB_FORM(turns)(j, &model->block[j], n, k);
    }
    HDB_FORM(phases)(no, half, s, n, k);
    HDB_UNROLL_FIXED
    for (int j = 0; j < no; ++j)
        HDB_FORM(sines)(j, half[j], n, k);
    for (int j = 0; j < ns; ++j) {
        int last = -1, other = -1; /* samples with two lengths of dt: even times have no more */
        for (int i = 0; i < n; ++i) {
            const hdb_real dt = LANE(k->dt[i], 0);
            if (last >= 0 && !(dt < LANE(k->dt[last], 0) || dt > LANE(k->dt[last], 0))) {
                for (int m = 0; m < 7; ++m)
                    k->f[j][i][m] = k->f[j][last][m];
            } else if (other >= 0 && !(dt < LANE(k->dt[other], 0) || dt > LANE(k->dt[other], 0))) {
                for (int m = 0; m < 7; ++m)
                    k->f[j][i][m] = k->f[j][other][m];
                other = last;
            } else {
                hdb_slow(&model->block[no + j], dt, k->f[j][i]);
                other = last;
            }
            last = i;
        }
    }
}

#ifdef HDB_SUMS
/* Take the logarithm of products of variances, from time to time. */
HDB_INLINE void HDB_FORM(tally)(lanes *s)
{
    if (++s->since < 8)
        return;
    s->since = 0;
    EACH_LANE {
        if (!(LANE(s->product, l) > 1e-150 && LANE(s->product, l) < 1e150)) {
            LANE(s->log_sum, l) += log(LANE(s->product, l));
            LANE(s->product, l) = 1;
        }
    }
}
#endif
