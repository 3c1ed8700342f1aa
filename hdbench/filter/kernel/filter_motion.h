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

/* Motor turn, expected torque and residual of sample i; advances the motion part of the state.
 * `a`, the angle, is NaN where there is none. What does not apply is computed and left. */
HDB_INLINE void HDB_FORM(observe)(const hdb_model *model, lanes *s, work *k, int i, number t,
                                  number v, number y, number a)
{
    number *const head = s->head;
    const number none = {0}, one = none + K(1.0), unknown = none + HDB_NAN;
    const number two_t = none + K(2.0) * model->constant, acc1 = head[HDB_ACCELERATION];
    const mask seen = head[HDB_SEEN] != none, moved = head[HDB_HAS_VELOCITY] != none;
    const mask placed = head[HDB_HAS_ANGLE] != none, moving = HDB_FORM(usable)(v);
    const mask located = HDB_FORM(usable)(a);
    const number dt = PICK(seen, t - head[HDB_TIME], none);
    const number coasted = PICK(seen & moved, head[HDB_VELOCITY] * dt, none);
    const number turned = PICK(located & placed, a - head[HDB_ANGLE], coasted);
    const number carried = PICK(placed, head[HDB_ANGLE] + turned, head[HDB_ANGLE]);
    /* acceleration = 2/(2T+dt) (v - v1) + (2T-dt)/(2T+dt) acceleration1 */
    const number dv = t - head[HDB_VELOCITY_TIME], scale = K(1.0) / (two_t + dv);
    const number acc = K(2.0) * scale * (v - head[HDB_VELOCITY]) + (two_t - dv) * scale * acc1;
    const number now = PICK(moving & moved, acc, acc1);
    const number expected = model->inertia / model->ratio * now;
    head[HDB_SEEN] = one;
    head[HDB_TIME] = t;
    head[HDB_HAS_ANGLE] = PICK(located, one, head[HDB_HAS_ANGLE]);
    head[HDB_ANGLE] = PICK(located, a, carried);
    head[HDB_ACCELERATION] = now;
    head[HDB_HAS_VELOCITY] = PICK(moving, one, head[HDB_HAS_VELOCITY]);
    head[HDB_VELOCITY] = PICK(moving, v, head[HDB_VELOCITY]);
    head[HDB_VELOCITY_TIME] = PICK(moving, t, head[HDB_VELOCITY_TIME]);
    k->turn[i] = PICK(HDB_FORM(abs)(turned) <= HDB_LARGEST, turned, none);
    k->dt[i] = dt;
    k->torque[i] = PICK(HDB_FORM(usable)(y), y, unknown);
    k->expected[i] = expected;
    k->residual[i] = PICK(moving & HDB_FORM(usable)(y), y - expected, unknown);
}

#ifdef HDB_COASTS
/* Whether nothing of any lane's last sample was missing. */
HDB_INLINE int HDB_FORM(flowing)(const lanes *s, int by_angle)
{
    int flows = 1;
    EACH_LANE {
        const hdb_real placed = LANE(s->head[HDB_HAS_ANGLE], l);
        flows = flows && LANE(s->head[HDB_SEEN], l) > 0 && LANE(s->head[HDB_HAS_VELOCITY], l) > 0 &&
                (placed > 0) == by_angle &&
                LANE(s->head[HDB_VELOCITY_TIME], l) >= LANE(s->head[HDB_TIME], l);
    }
    return flows;
}

/* The same for n samples of which none is missing, after one of which nothing was, but for the
 * acceleration, left to `coast`; 0 where this does not hold, and nothing was touched. All lanes
 * share the time. */
HDB_INLINE int HDB_FORM(observe_all)(const hdb_model *model, lanes *s, work *k, int n,
                                     const hdb_real *t, const number *v, const number *y,
                                     const number *a)
{
    number *const head = s->head;
    const number none = {0};
    const hdb_real two_t = K(2.0) * model->constant;
    hdb_real gap[HDB_CHUNK], scale[HDB_CHUNK];
    k->coasting = 0;
    if (n < 1 || !HDB_FORM(flowing)(s, a != NULL))
        return 0;
    gap[0] = t[0] - LANE(head[HDB_TIME], 0);
    for (int i = 1; i < n; ++i)
        gap[i] = t[i] - t[i - 1];
    k->turn[0] = a == NULL ? head[HDB_VELOCITY] * gap[0] : a[0] - head[HDB_ANGLE];
    for (int i = 1; i < n; ++i)
        k->turn[i] = a == NULL ? v[i - 1] * gap[i] : a[i] - a[i - 1];
    mask good = HDB_FORM(usable)(v[0]);
    for (int i = 0; i < n; ++i) {
        good &= HDB_FORM(usable)(v[i]) & HDB_FORM(usable)(y[i]) &
                (HDB_FORM(abs)(k->turn[i]) <= HDB_LARGEST);
        k->torque[i] = y[i];
        k->dt[i] = none + gap[i];
    }
    for (int i = 0; a != NULL && i < n; ++i)
        good &= HDB_FORM(usable)(a[i]);
    if (ANY(HDB_NOT(good)))
        return 0;
    for (int i = 0; i < n; ++i)
        scale[i] = K(1.0) / (two_t + gap[i]);
    k->push[0] = K(2.0) * scale[0] * (v[0] - head[HDB_VELOCITY]);
    for (int i = 1; i < n; ++i)
        k->push[i] = K(2.0) * scale[i] * (v[i] - v[i - 1]);
    for (int i = 0; i < n; ++i)
        k->carry[i] = (two_t - gap[i]) * scale[i];
    k->coasting = 1;
    head[HDB_TIME] = head[HDB_VELOCITY_TIME] = none + t[n - 1];
    head[HDB_VELOCITY] = v[n - 1];
    if (a != NULL)
        head[HDB_ANGLE] = a[n - 1];
    return 1;
}

/* Expected torque and residual of a chunk that coasts. */
HDB_INLINE void HDB_FORM(coast)(const hdb_model *model, lanes *s, int n, work *k)
{
    const hdb_real inertia = model->inertia / model->ratio;
    number acceleration = s->head[HDB_ACCELERATION];
    for (int i = 0; k->coasting && i < n; ++i) {
        acceleration = k->push[i] + k->carry[i] * acceleration;
        k->expected[i] = inertia * acceleration;
        k->residual[i] = k->torque[i] - k->expected[i];
    }
    s->head[HDB_ACCELERATION] = acceleration;
}
#endif

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

/* psi += turn, less whole turns beyond a limit; a float also carries what rounding left over. */
HDB_INLINE void HDB_FORM(advance)(number *psi, number *left, number turn)
{
#ifdef HDB_SINGLE
    const number more = turn + *left, sum = *psi + more;
    *left = more - (sum - *psi);
#else
    const number sum = *psi + turn;
    (void)left;
#endif
    *psi = sum;
    const mask beyond = HDB_FORM(abs)(sum) > HDB_PHASE_LIMIT;
#if HDB_LANES == 1
    if (!beyond)
        return;
#endif
    const number n = HDB_FORM(nearest)(sum * K(0x1.45f306dc9c883p-3));
#ifdef HDB_SINGLE
    *psi = ((sum - n * 0x1.92p2f) - n * 0x1.fb54p-10f) - n * 0x1.10b46p-28f;
#else
    *psi = PICK(beyond, (sum - n * 0x1.921fb5440p2) - n * 0x1.0b4611a60p-32, sum);
#endif
}

/* How far one oscillator turns from sample to sample, in k->psi. */
HDB_INLINE void HDB_FORM(turns)(int j, const hdb_block *b, int n, work *k)
{
    number *const psi = k->psi[j];
    mask far = {0};
    for (int i = 0; i < n; ++i) {
        psi[i] = b->omega > 0 ? b->omega * k->dt[i] : b->order * k->turn[i];
        far |= HDB_FORM(abs)(psi[i]) > HDB_PHASE_LIMIT;
    }
    if (ANY(far))
        for (int i = 0; i < n; ++i)
            EACH_LANE LANE(psi[i], l) = hdb_turn_within(LANE(psi[i], l));
}

#if HDB_LANES > 1
/* Phase of one oscillator at every sample, in k->psi. Whole turns are seldom due in any lane. */
HDB_INLINE void HDB_FORM(phase)(int j, lanes *s, int n, work *k)
{
    number now = s->psi[j], left = s->left[j], psi[HDB_CHUNK];
    mask beyond = {0};
    for (int i = 0; i < n; ++i) {
        psi[i] = now = now + k->psi[j][i];
        beyond |= HDB_FORM(abs)(now) > HDB_PHASE_LIMIT;
    }
    if (ANY(beyond)) {
        now = s->psi[j];
        for (int i = 0; i < n; ++i) {
            HDB_FORM(advance)(&now, &left, k->psi[j][i]);
            psi[i] = now;
        }
    }
    for (int i = 0; i < n; ++i)
        k->psi[j][i] = psi[i];
    s->psi[j] = now;
}

HDB_INLINE void HDB_FORM(phases)(int no, const int *half, lanes *s, int n, work *k)
{
    for (int j = 0; j < no; ++j)
        if (half[j] < 0)
            HDB_FORM(phase)(j, s, n, k);
}
#else
/* Phase of every oscillator at every sample, in k->psi: what each sample adds to the one before, in
 * one loop, so that the sums overlap. */
HDB_INLINE void HDB_FORM(phases)(int no, const int *half, lanes *s, int n, work *k)
{
    const number none = {0};
    number now[HDB_MAX_BLOCKS], left[HDB_MAX_BLOCKS];
    HDB_UNROLL
    for (int j = 0; j < HDB_MAX_BLOCKS; ++j) {
        now[j] = j < no ? s->psi[j] : none;
        left[j] = j < no ? s->left[j] : none;
    }
    for (int i = 0; i < n; ++i) {
        HDB_UNROLL
        for (int j = 0; j < no; ++j) {
            if (half[j] >= 0)
                continue;
            HDB_FORM(advance)(&now[j], &left[j], k->psi[j][i]);
            k->psi[j][i] = now[j];
        }
    }
    HDB_UNROLL
    for (int j = 0; j < no; ++j) {
        s->psi[j] = now[j];
        s->left[j] = left[j];
    }
}
#endif

/* Cosine and sine of oscillator j. Where one before, `half`, turns through half its angle a, by
 * sin 2a = 2 sin a cos a and cos 2a = 1 - 2 sin^2 a; no phase of its own is kept then. */
HDB_INLINE void HDB_FORM(sines)(int j, int half, int n, work *k)
{
    if (half < 0) {
        for (int i = 0; i < n; ++i)
            SINCOS(k->psi[j][i], &k->sine[j][i], &k->cosine[j][i]);
        return;
    }
    for (int i = 0; i < n; ++i) {
        const number sine = k->sine[half][i], twice = sine + sine;
        k->sine[j][i] = twice * k->cosine[half][i];
        k->cosine[j][i] = K(1.0) - twice * sine;
    }
}

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
