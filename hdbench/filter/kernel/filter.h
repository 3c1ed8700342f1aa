/* Time-varying Kalman filter of order-locked torque (report CIM-TR-97-06, equations 5-10).
 *
 * Model. Blocks of two states (N m), the oscillators first. With the motor turn D (rad) and the
 * time dt (s) since the sample before, a block adds to the torque
 *   oscillator   C z = cos(psi) z1 + sin(psi) z2,  psi += order * D + omega * dt,  F = I,
 *                Q = (q_sample + q_rad |D| + q_s dt) I: the report's turning states, seen in axes
 *                that turn with them, where they rest
 *   slow torque  C z = z1: random walk, integrated walk, Ornstein-Uhlenbeck, Matern 3/2
 *     z- = F z,  P- = F P F' + Q,  S = R + C P- C',  e = y - C z-,
 *     z = z- + P- C' e / S,  P = P- - P- C' C P- / S         [with the report's K: equations 8-10]
 * y = torque - J acceleration / N with the acceleration s/(T s + 1) by Tustin with the local
 * period. D = last velocity * dt, or the difference of measured angles. Filtered torque = torque -
 * predicted ripple and misalignment; a slow torque stays in.
 *
 * Missing samples. A value is missing where it is NaN or beyond HDB_USABLE in magnitude. Without
 * torque or velocity the sample only predicts, as does one beyond the gate. A missing velocity
 * holds the last one and its acceleration; a missing angle advances by the held velocity.
 *
 * Ownership. The caller owns every buffer; nothing is allocated, kept, printed or shared, so calls
 * on different states may run in parallel. Outputs must not overlap inputs. Splitting a record into
 * calls of any length changes no bit. P is symmetric to the last bit.
 * HDB_SINGLE makes every number a float; then a block's variance is bounded by HDB_HELD times that
 * of measurement and process noise, beyond which a float's P would lose its sign (standstill).
 */
#ifndef HDBENCH_FILTER_H
#define HDBENCH_FILTER_H

#include <stddef.h>
#include <stdint.h>

#ifdef HDB_SINGLE
typedef float hdb_real;
#else
typedef double hdb_real;
#endif

#ifndef HDB_MAX_BLOCKS
#define HDB_MAX_BLOCKS 16
#endif
#ifndef HDB_MAX_SLOW
#define HDB_MAX_SLOW HDB_MAX_BLOCKS
#endif
#define HDB_USABLE 1e12 /* rad/s, rad, N m: beyond this a sample is a fault, not a measurement */
#define HDB_RESOLVED 200 /* innovation variances: a block with more is not known from the data */
#define HDB_HELD 1e5f    /* see HDB_SINGLE above */
#define HDB_STATE_SIZE(n_blocks) (HDB_HEADER + 6 * (n_blocks) + (n_blocks) * (2 * (n_blocks) + 1))

typedef enum { HDB_OK = 0, HDB_ERR_CONFIG, HDB_ERR_TIME } hdb_status; /* nothing was touched */
enum { HDB_OSCILLATOR, HDB_RANDOM_WALK, HDB_INTEGRATED_WALK, HDB_ORNSTEIN_UHLENBECK, HDB_MATERN,
       HDB_RESONANCE };
enum { HDB_RIPPLE, HDB_MISALIGNMENT, HDB_SLOW };
enum { HDB_MISSING = 1, HDB_GATED = 2, HDB_UNRESOLVED = 4 }; /* bits of a sample's flag */

/* State vector: this header, psi (rad) and its rounding left over [2 n_blocks], z[2 n_blocks],
 * g[2 n_blocks], then the lower triangle of P row by row. A double keeps z and P as predicted for
 * the last sample, with what its measurement is to change: g = P C', 1/S and e/S. The next sample's
 * C z, P C' and S are found while 1/S is under way; z and P are brought up then. A float keeps z
 * and P after the measurement, and no g. All zero: nothing seen yet. */
enum {
    HDB_SEEN, HDB_HAS_VELOCITY, HDB_HAS_ANGLE, HDB_STARTED /* each 0 or 1 */, HDB_TIME /* s */,
    HDB_VELOCITY /* rad/s, last usable */, HDB_VELOCITY_TIME /* s, when it was sampled */,
    HDB_ACCELERATION /* rad/s^2 */, HDB_ANGLE /* rad, measured or carried on */,
    HDB_GATED_RUN /* samples gated in a row */,
    HDB_INVERSE, HDB_STEP /* 1/S and e/S to be done; 0 after a sample that only predicts */,
    HDB_HEADER
};

typedef struct {
    int kind, part;
    hdb_real order, omega;              /* cycles per motor turn; rad/s */
    hdb_real q_sample, q_rad, q_s;      /* (N m)^2 per sample, per rad of the motor, per s */
    hdb_real rate, variance;            /* 1/s and (N m)^2 of the stationary kinds */
    hdb_real prior[2];                  /* (N m)^2, unless the start is the listing's */
} hdb_block;

typedef struct {
    int n_oscillators, n_slow;
    hdb_real r, inertia, ratio, constant; /* R (N m)^2; J kg m^2; N; T s */
    hdb_real gate, gate_samples;          /* squared standard deviations, 0: none; most in a row */
    int prior_start; /* 1: z = 0, P = prior; 0 (listing): each block is the first residual, P = I */
    hdb_block block[HDB_MAX_BLOCKS];
} hdb_model;

typedef struct { /* the same numbers for a step, with room for HDB_MAX_BLOCKS; all zero at first */
    hdb_real head[HDB_HEADER], psi[HDB_MAX_BLOCKS], left[HDB_MAX_BLOCKS];
    hdb_real z[2 * HDB_MAX_BLOCKS], p[HDB_MAX_BLOCKS * (2 * HDB_MAX_BLOCKS + 1)];
#ifndef HDB_SINGLE
    hdb_real g[2 * HDB_MAX_BLOCKS];
#endif
} hdb_state;

typedef struct { /* of one sample, N m and (N m)^2 */
    hdb_real expected, ripple, misalignment, slow, filtered, innovation, variance;
    int flag;
} hdb_output;

/* One sample, dt s after the one before: velocity (rad/s), torque (N m); state is in and out. */
void hdb_filter_step(const hdb_model *model, hdb_state *state, hdb_real dt, hdb_real velocity,
                     hdb_real torque, hdb_output *out);

/* HDB_ERR_CONFIG where a number of the model is out of its domain. */
hdb_status hdb_model_check(const hdb_model *model);

#endif
