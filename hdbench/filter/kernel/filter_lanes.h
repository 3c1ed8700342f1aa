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
#else
#define LANE(value, l) (((hdb_real *)&(value))[l])
typedef hdb_real HDB_FORM(number) __attribute__((vector_size(L * sizeof(hdb_real))));
typedef int64_t HDB_FORM(mask) __attribute__((vector_size(L * sizeof(hdb_real))));
#define PICK(which, one, other)                                                                   \
    ((number)(((mask)(one) & (which)) | ((mask)(other) & ~(which))))
#define ANY(which) HDB_FORM(any)(which)
#endif
#define number HDB_FORM(number)
#define mask HDB_FORM(mask)
#define lanes HDB_FORM(lanes)
#define work HDB_FORM(work)

#ifdef HDB_SUMS
typedef struct {
    number head[HDB_HEADER], psi[HDB_MAX_BLOCKS], left[HDB_MAX_BLOCKS];
    number z[STATES], p[AT(STATES, 0)];
    number used, product, log_sum, squares;
    int since; /* samples since the product was looked at */
} lanes;
#else
typedef hdb_state lanes;
#endif

typedef struct { /* one chunk */
    number turn[HDB_CHUNK], dt[HDB_CHUNK], torque[HDB_CHUNK], residual[HDB_CHUNK];
    number psi[HDB_MAX_BLOCKS][HDB_CHUNK], noise[HDB_MAX_BLOCKS][HDB_CHUNK];
    number cosine[HDB_MAX_BLOCKS][HDB_CHUNK], sine[HDB_MAX_BLOCKS][HDB_CHUNK];
    hdb_real f[HDB_MAX_SLOW][HDB_CHUNK][7]; /* of slow torques; all lanes share the time */
    number expected[HDB_CHUNK], part[3][HDB_CHUNK], filtered[HDB_CHUNK];
    number innovation[HDB_CHUNK], variance[HDB_CHUNK], flag[HDB_CHUNK];
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
HDB_INLINE number HDB_FORM(abs)(number value) { return PICK(value < K(0), -value, value); }
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
    const number expected = model->inertia * now / model->ratio;
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

/* Sine and cosine by Taylor polynomials on [-pi/4, pi/4]; first omitted terms below 5e-17 (3e-8).
 * The double form lacks 2.0e-21 of pi/2, so r is off by 1.3e-16 at most. */
HDB_INLINE void HDB_FORM(sincos)(number a, number *sine, number *cosine)
{
    const number k = HDB_FORM(nearest)(a * K(0x1.45f306dc9c883p-1));
#ifdef HDB_SINGLE
    const number r = ((a - k * 0x1.92p0f) - k * 0x1.fb54p-12f) - k * 0x1.10b46p-30f, z = r * r;
    number s = z * K(1.0 / 362880.0) - K(1.0 / 5040.0), c = z * K(1.0 / 40320.0);
#else
    const number r = (a - k * 0x1.921fb5440p0) - k * 0x1.0b4611a60p-34, z = r * r;
    number s = z * (-1.0 / 1307674368000.0) + 1.0 / 6227020800.0;
    s = s * z - 1.0 / 39916800.0;
    s = s * z + 1.0 / 362880.0;
    s = s * z - 1.0 / 5040.0;
    number c = z * (1.0 / 20922789888000.0) - 1.0 / 87178291200.0;
    c = c * z + 1.0 / 479001600.0;
    c = c * z - 1.0 / 3628800.0;
    c = (c * z + 1.0 / 40320.0) * z;
#endif
    s = s * z + K(1.0 / 120.0);
    s = s * z - K(1.0 / 6.0);
    c = c - K(1.0 / 720.0);
    c = c * z + K(1.0 / 24.0);
    s = r + r * (z * s);
    c = K(1.0) + (z * z * c - K(0.5) * z);
    /* quarter turn m = k mod 4 in {-2, -1, 0, 1, 2}: i^m = axis + i * side */
    const number m = k - K(4.0) * HDB_FORM(nearest)(k * K(0.25));
    const number odd = m * m * (K(4.0) - m * m) * K(1.0 / 3.0); /* 0, 1, 0, 1, 0 */
    const number side = m * odd;
    const number axis = (K(1.0) - odd) * (K(1.0) - K(0.5) * m * m);
    *cosine = axis * c - side * s;
    *sine = axis * s + side * c;
}

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
    if (ANY(beyond)) {
        const number n = HDB_FORM(nearest)(sum * K(0x1.45f306dc9c883p-3));
#ifdef HDB_SINGLE
        *psi = ((sum - n * 0x1.92p2f) - n * 0x1.fb54p-10f) - n * 0x1.10b46p-28f;
#else
        *psi = PICK(beyond, (sum - n * 0x1.921fb5440p2) - n * 0x1.0b4611a60p-32, sum);
#endif
    }
}

/* Cosine, sine and process noise of every oscillator, transition of every slow torque. */
HDB_INLINE void HDB_FORM(turn)(int no, int ns, const hdb_model *model, lanes *s, int n, work *k)
{
    for (int j = 0; j < no; ++j) {
        const hdb_block *const b = &model->block[j];
        mask far = {0};
        for (int i = 0; i < n; ++i) { /* what the model has not is left out, not multiplied by 0 */
            number noise = (number){0} + b->q_sample;
            if (b->q_rad > 0)
                noise += b->q_rad * HDB_FORM(abs)(k->turn[i]);
            if (b->q_s > 0)
                noise += b->q_s * k->dt[i];
            k->noise[j][i] = noise;
            k->psi[j][i] = b->omega > 0 ? b->omega * k->dt[i] : b->order * k->turn[i];
            far |= HDB_FORM(abs)(k->psi[j][i]) > HDB_PHASE_LIMIT;
        }
        if (ANY(far))
            for (int i = 0; i < n; ++i)
                EACH_LANE LANE(k->psi[j][i], l) = hdb_turn_within(LANE(k->psi[j][i], l));
    }
    for (int i = 0; i < n; ++i) {
        HDB_UNROLL
        for (int j = 0; j < no; ++j) {
            HDB_FORM(advance)(&s->psi[j], &s->left[j], k->psi[j][i]);
            k->psi[j][i] = s->psi[j];
        }
    }
    for (int j = 0; j < no; ++j)
        for (int i = 0; i < n; ++i)
            HDB_FORM(sincos)(k->psi[j][i], &k->sine[j][i], &k->cosine[j][i]);
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
