#include "oscillator.h"

#include <math.h>
#include <string.h>

#if defined(__GNUC__)
#define HDB_INLINE static inline __attribute__((always_inline))
#elif defined(_MSC_VER)
#define HDB_INLINE static __forceinline
#else
#define HDB_INLINE static inline
#endif

#define CHUNK 64 /* samples whose sines are computed together; changes speed only */
#define PAIRS (HDB_MAX_BLOCKS * (HDB_MAX_BLOCKS - 1) / 2)

/* Inputs of the recursion for one chunk. */
typedef struct {
    double turn[CHUNK];     /* rad of the motor from the previous sample to this one */
    double residual[CHUNK]; /* N m; NaN where the sample only predicts */
    double cosine[HDB_MAX_BLOCKS][CHUNK];
    double sine[HDB_MAX_BLOCKS][CHUNK];
} chunk;

size_t hdb_state_size(size_t n_blocks)
{
    return (size_t)HDB_HEADER + 2 * n_blocks + n_blocks * (2 * n_blocks + 1);
}

HDB_INLINE int usable(double value) { return fabs(value) <= HDB_USABLE; }

/* Sine and cosine by Taylor polynomials on [-pi/4, pi/4]; the first omitted terms are below 5e-17.
 * k = nearest integer to a / (pi/2), r = a - k pi/2 with pi/2 as the sum of two numbers of 33 bit,
 * which lack 2.0e-21: up to REDUCIBLE both products are exact and r is off by 1.3e-16 at most. */
#define REDUCIBLE 1e5 /* rad: k stays below 2^16 */

static void sines_of(size_t n, const double *turn, double order, double *cosine, double *sine)
{
    const double two_over_pi = 0x1.45f306dc9c883p-1, round_bias = 0x1.8p52;
    const double part1 = 0x1.921fb5440p0, part2 = 0x1.0b4611a60p-34;
    for (size_t i = 0; i < n; ++i) {
        const double a = order * turn[i];
        const double k = (a * two_over_pi + round_bias) - round_bias;
        const double r = (a - k * part1) - k * part2;
        const double z = r * r;
        double s = -1.0 / 1307674368000.0;
        s = s * z + 1.0 / 6227020800.0;
        s = s * z - 1.0 / 39916800.0;
        s = s * z + 1.0 / 362880.0;
        s = s * z - 1.0 / 5040.0;
        s = s * z + 1.0 / 120.0;
        s = s * z - 1.0 / 6.0;
        s = r + r * (z * s);
        double c = 1.0 / 20922789888000.0;
        c = c * z - 1.0 / 87178291200.0;
        c = c * z + 1.0 / 479001600.0;
        c = c * z - 1.0 / 3628800.0;
        c = c * z + 1.0 / 40320.0;
        c = c * z - 1.0 / 720.0;
        c = c * z + 1.0 / 24.0;
        c = 1.0 + (z * z * c - 0.5 * z);
        /* quarter turn m = k mod 4 in {-2, -1, 0, 1, 2}: i^m = axis + i * side */
        const double m = k - 4.0 * ((k * 0.25 + round_bias) - round_bias);
        const double odd = m * m * (4.0 - m * m) * (1.0 / 3.0); /* 0, 1, 0, 1, 0 */
        const double side = m * odd;
        const double axis = (1.0 - odd) * (1.0 - 0.5 * m * m);
        cosine[i] = axis * c - side * s;
        sine[i] = axis * s + side * c;
    }
    for (size_t i = 0; i < n; ++i) {
        const double a = order * turn[i];
        if (!(fabs(a) <= REDUCIBLE)) { /* beyond any phase that a record can carry, yet finite */
            const int known = isfinite(a);
            cosine[i] = known ? cos(a) : 1.0;
            sine[i] = known ? sin(a) : 0.0;
        }
    }
}

/* Motor turn, expected torque and residual of one sample; advances the motion part of the state. */
HDB_INLINE void observe(const hdb_config *config, double *state, double t, double v, double torque,
                        const double *angle, double *turn, double *expected, double *residual)
{
    const double two_t = 2.0 * config->differentiator_time_constant;
    double turned = 0.0;
    if (state[HDB_SEEN] != 0.0 && state[HDB_HAS_VELOCITY] != 0.0)
        turned = state[HDB_VELOCITY] * (t - state[HDB_TIME]);
    if (angle != NULL && usable(*angle)) {
        if (state[HDB_HAS_ANGLE] != 0.0)
            turned = *angle - state[HDB_ANGLE];
        state[HDB_ANGLE] = *angle;
        state[HDB_HAS_ANGLE] = 1.0;
    } else if (state[HDB_HAS_ANGLE] != 0.0) {
        state[HDB_ANGLE] += turned;
    }
    const int moving = usable(v);
    if (moving) {
        if (state[HDB_HAS_VELOCITY] != 0.0) {
            /* a = 2/(2T+dt) (v - v1) + (2T-dt)/(2T+dt) a1 */
            const double dt = t - state[HDB_VELOCITY_TIME];
            const double scale = 1.0 / (two_t + dt);
            state[HDB_ACCELERATION] = 2.0 * scale * (v - state[HDB_VELOCITY]) +
                                      (two_t - dt) * scale * state[HDB_ACCELERATION];
        }
        state[HDB_HAS_VELOCITY] = 1.0;
        state[HDB_VELOCITY] = v;
        state[HDB_VELOCITY_TIME] = t;
    }
    state[HDB_SEEN] = 1.0;
    state[HDB_TIME] = t;
    *turn = turned;
    *expected = config->load_inertia * state[HDB_ACCELERATION] / config->gear_ratio;
    *residual = moving && usable(torque) ? torque - *expected : (double)NAN;
}

/* P = I, x = first residual in the first state of every block. */
static void start(size_t nb, double *x, double *p, double residual)
{
    memset(p, 0, nb * (2 * nb + 1) * sizeof *p);
    for (size_t i = 0; i < nb; ++i) {
        x[2 * i] = residual;
        x[2 * i + 1] = 0.0;
        p[3 * i] = 1.0;
        p[3 * i + 2] = 1.0;
    }
}

/* x <- Phi x, P <- Phi P Phi' + Q, block by block. */
HDB_INLINE void turn_blocks(size_t nb, double *x, double *p, const double *c, const double *s,
                            const double *q)
{
    for (size_t i = 0; i < nb; ++i) {
        const double x0 = x[2 * i], x1 = x[2 * i + 1];
        x[2 * i] = c[i] * x0 + s[i] * x1;
        x[2 * i + 1] = c[i] * x1 - s[i] * x0;
    }
    for (size_t i = 0; i < nb; ++i) { /* [a b; b d], turned about its mean diagonal */
        double *d = p + 3 * i;
        const double mean = 0.5 * (d[0] + d[2]), half = 0.5 * (d[0] - d[2]), b = d[1];
        const double cc = c[i] * c[i] - s[i] * s[i], ss = 2.0 * c[i] * s[i];
        const double h = cc * half + ss * b;
        d[0] = (mean + q[i]) + h;
        d[1] = cc * b - ss * half;
        d[2] = (mean + q[i]) - h;
    }
    double *o = p + 3 * nb;
    for (size_t i = 0; i < nb; ++i) {
        for (size_t j = i + 1; j < nb; ++j, o += 4) { /* Phi_i O Phi_j' */
            const double l0 = c[i] * o[0] + s[i] * o[2], l1 = c[i] * o[1] + s[i] * o[3];
            const double m0 = c[i] * o[2] - s[i] * o[0], m1 = c[i] * o[3] - s[i] * o[1];
            o[0] = l0 * c[j] + l1 * s[j];
            o[1] = l1 * c[j] - l0 * s[j];
            o[2] = m0 * c[j] + m1 * s[j];
            o[3] = m1 * c[j] - m0 * s[j];
        }
    }
}

/* x <- x + P C' e / S, P <- P - P C' C P / S. */
HDB_INLINE void measure(size_t nb, double *x, double *p, double innovation, double r)
{
    double g[2 * HDB_MAX_BLOCKS], k[2 * HDB_MAX_BLOCKS]; /* P C' and P C' / S */
    double variance = r;
    for (size_t i = 0; i < nb; ++i) {
        g[2 * i] = p[3 * i];
        g[2 * i + 1] = p[3 * i + 1];
    }
    double *o = p + 3 * nb;
    for (size_t i = 0; i < nb; ++i) {
        for (size_t j = i + 1; j < nb; ++j, o += 4) {
            g[2 * i] += o[0];
            g[2 * i + 1] += o[2];
            g[2 * j] += o[0];
            g[2 * j + 1] += o[1];
        }
    }
    for (size_t i = 0; i < nb; ++i)
        variance += g[2 * i];
    const double inverse = 1.0 / variance;
    for (size_t i = 0; i < 2 * nb; ++i) {
        k[i] = g[i] * inverse;
        x[i] += k[i] * innovation;
    }
    for (size_t i = 0; i < nb; ++i) {
        p[3 * i] -= k[2 * i] * g[2 * i];
        p[3 * i + 1] -= k[2 * i] * g[2 * i + 1];
        p[3 * i + 2] -= k[2 * i + 1] * g[2 * i + 1];
    }
    o = p + 3 * nb;
    for (size_t i = 0; i < nb; ++i) {
        for (size_t j = i + 1; j < nb; ++j, o += 4) {
            o[0] -= k[2 * i] * g[2 * j];
            o[1] -= k[2 * i] * g[2 * j + 1];
            o[2] -= k[2 * i + 1] * g[2 * j];
            o[3] -= k[2 * i + 1] * g[2 * j + 1];
        }
    }
}

/* The recursion over one chunk; inlined once per usual number of blocks so that it unrolls. */
HDB_INLINE void recurse(size_t nb, const hdb_config *config, double *state, size_t n,
                        const chunk *in, const double *torque, double *ripple, double *misaligned,
                        double *filtered)
{
    double x[2 * HDB_MAX_BLOCKS], p[3 * HDB_MAX_BLOCKS + 4 * PAIRS];
    double c[HDB_MAX_BLOCKS], s[HDB_MAX_BLOCKS], q[HDB_MAX_BLOCKS], role[HDB_MAX_BLOCKS];
    double *const kept = state + HDB_HEADER;
    const double r = config->measurement_noise;
    int started = state[HDB_STARTED] != 0.0;
    for (size_t i = 0; i < 2 * nb; ++i)
        x[i] = kept[i];
    for (size_t i = 0; i < nb * (2 * nb + 1); ++i)
        p[i] = kept[2 * nb + i];
    for (size_t i = 0; i < nb; ++i) {
        q[i] = config->process_noise[i];
        role[i] = config->misalignment[i];
    }
    for (size_t k = 0; k < n; ++k) {
        const double residual = in->residual[k];
        const int known = !isnan(residual);
        double order_part = 0.0, output_part = 0.0, innovation = residual;
        if (started) {
            for (size_t i = 0; i < nb; ++i) {
                c[i] = in->cosine[i][k];
                s[i] = in->sine[i][k];
            }
            turn_blocks(nb, x, p, c, s, q);
            for (size_t i = 0; i < nb; ++i) {
                order_part += (1.0 - role[i]) * x[2 * i];
                output_part += role[i] * x[2 * i];
            }
            innovation -= order_part + output_part;
        } else if (known) {
            start(nb, x, p, residual);
            started = 1;
            for (size_t i = 0; i < nb; ++i)
                innovation -= residual;
        }
        ripple[k] = order_part;
        misaligned[k] = output_part;
        filtered[k] = usable(torque[k]) ? torque[k] - (order_part + output_part) : (double)NAN;
        if (known)
            measure(nb, x, p, innovation, r);
    }
    state[HDB_STARTED] = started ? 1.0 : 0.0;
    if (!started)
        return;
    for (size_t i = 0; i < 2 * nb; ++i)
        kept[i] = x[i];
    for (size_t i = 0; i < nb * (2 * nb + 1); ++i)
        kept[2 * nb + i] = p[i];
}

static int positive(double value) { return value > 0.0 && isfinite(value); }

static hdb_status check_config(const hdb_config *config)
{
    if (config->n_blocks < 1 || config->n_blocks > HDB_MAX_BLOCKS)
        return HDB_ERR_CONFIG;
    for (size_t i = 0; i < config->n_blocks; ++i) {
        if (!positive(config->order[i]) || !positive(config->process_noise[i]))
            return HDB_ERR_CONFIG;
        if (config->misalignment[i] != 0.0 && config->misalignment[i] != 1.0)
            return HDB_ERR_CONFIG;
    }
    if (!positive(config->measurement_noise) || !positive(config->gear_ratio) ||
        !positive(config->differentiator_time_constant) ||
        !(config->load_inertia == 0.0 || positive(config->load_inertia)))
        return HDB_ERR_CONFIG;
    return HDB_OK;
}

static hdb_status check_time(const double *state, size_t n, const double *time, size_t *bad)
{
    for (size_t k = 0; k < n; ++k) {
        const int first = k == 0 && state[HDB_SEEN] == 0.0;
        const double before = k > 0 ? time[k - 1] : state[HDB_TIME];
        if (!isfinite(time[k]) || !(first || time[k] > before)) {
            *bad = k;
            return HDB_ERR_TIME;
        }
    }
    return HDB_OK;
}

hdb_status hdb_filter_run(const hdb_config *config, double *state, size_t n, const double *time,
                          const double *velocity, const double *torque, const double *angle,
                          double *expected, double *ripple, double *misaligned, double *filtered,
                          size_t *bad)
{
    chunk work;
    const size_t nb = config->n_blocks;
    hdb_status status = check_config(config);
    if (status == HDB_OK)
        status = check_time(state, n, time, bad);
    if (status != HDB_OK)
        return status;
    for (size_t from = 0; from < n; from += CHUNK) {
        const size_t m = n - from < CHUNK ? n - from : CHUNK;
        for (size_t k = 0; k < m; ++k)
            observe(config, state, time[from + k], velocity[from + k], torque[from + k],
                    angle == NULL ? NULL : angle + from + k, &work.turn[k], &expected[from + k],
                    &work.residual[k]);
        for (size_t i = 0; i < nb; ++i)
            sines_of(m, work.turn, config->order[i], work.cosine[i], work.sine[i]);
        const double *const y = torque + from;
        double *const a = ripple + from, *const b = misaligned + from, *const f = filtered + from;
        switch (nb) {
        case 1: recurse(1, config, state, m, &work, y, a, b, f); break;
        case 2: recurse(2, config, state, m, &work, y, a, b, f); break;
        case 3: recurse(3, config, state, m, &work, y, a, b, f); break;
        case 4: recurse(4, config, state, m, &work, y, a, b, f); break;
        default: recurse(nb, config, state, m, &work, y, a, b, f); break;
        }
    }
    return HDB_OK;
}
