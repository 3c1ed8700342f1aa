/* Time-varying Kalman predictor of order-locked torque (report CIM-TR-97-06, equations 5-10).
 *
 * Model. Block i holds two states (N m): the torque component at `order[i]` cycles per turn of the
 * wave generator and its quadrature. With the motor turn D(k) from sample k to k+1 (rad):
 *     x(k+1) = Phi(k) x(k) + w     Phi_i = [cos a, sin a; -sin a, cos a],  a = order[i] * D(k)
 *     y(k)   = sum of the first states + v                cov w = process_noise[i] I,  var v = R
 *     P(k+1) = Q + Phi (P - P C' C P / S) Phi',  S = R + C P C'      [equal to equations 9 and 10]
 * D(k) = velocity(k) * (t(k+1) - t(k)), or the difference of the measured angle where one is given.
 * y = torque - J acceleration / N; the acceleration is s/(T s + 1) by Tustin with the local period.
 * Start: at the first sample with torque and velocity, P = I and the first state of every block is
 * that residual; the prediction reported up to and including that sample is 0.
 *
 * Missing samples. A value is missing where it is NaN or beyond HDB_USABLE in magnitude. Without
 * torque or velocity the sample only predicts. A missing velocity holds the last one (and the last
 * acceleration; the next difference spans the true time since). A missing angle advances by the held
 * velocity, and the next measured one closes the gap. `filtered` is NaN where torque is missing.
 *
 * Ownership. The caller owns every buffer; nothing is allocated, kept, printed or shared, so calls
 * on different states may run in parallel. Outputs must not overlap inputs. Splitting a record into
 * calls of any length changes no bit. P is stored once per pair of states, so it is symmetric.
 */
#ifndef HDBENCH_FILTER_KERNEL_OSCILLATOR_H
#define HDBENCH_FILTER_KERNEL_OSCILLATOR_H

#include <stddef.h>

#define HDB_MAX_BLOCKS 16
#define HDB_USABLE 1e12 /* rad/s, rad, N m: beyond this a sample is a fault, not a measurement */

typedef enum {
    HDB_OK = 0,
    HDB_ERR_CONFIG = 1, /* a parameter is out of its domain; nothing was touched */
    HDB_ERR_TIME = 2    /* time does not increase or is not finite; nothing was touched */
} hdb_status;

/* State vector: the header below, then x[2 n_blocks], then P: (p11, p12, p22) of each block, then
 * (p11, p12, p21, p22) of each pair i < j in row order. x and P are those after the last sample's
 * measurement and before its transition, which needs the next time. All zero: nothing seen yet. */
enum {
    HDB_SEEN = 0,      /* 1: `time` is set */
    HDB_HAS_VELOCITY,  /* 1: velocity, its time and acceleration are set */
    HDB_HAS_ANGLE,     /* 1: angle is set */
    HDB_STARTED,       /* 1: x and P are set */
    HDB_TIME,          /* s, last sample */
    HDB_VELOCITY,      /* rad/s, last usable */
    HDB_VELOCITY_TIME, /* s, when it was sampled */
    HDB_ACCELERATION,  /* rad/s^2 */
    HDB_ANGLE,         /* rad, measured or carried on */
    HDB_HEADER
};

typedef struct {
    size_t n_blocks;                    /* 1 .. HDB_MAX_BLOCKS */
    const double *order;                /* [n_blocks] cycles per motor turn, > 0 */
    const double *process_noise;        /* [n_blocks] (N m)^2 per sample, > 0 */
    const double *misalignment;         /* [n_blocks] 1: output-order block, 0: ripple block */
    double measurement_noise;           /* R, (N m)^2, > 0 */
    double load_inertia;                /* J, kg m^2, >= 0 */
    double gear_ratio;                  /* N, > 0 */
    double differentiator_time_constant; /* T, s, > 0 */
} hdb_config;

/* Number of doubles in the state of n_blocks blocks. */
size_t hdb_state_size(size_t n_blocks);

/* Filter n samples: time (s), velocity (rad/s), torque (N m), angle (rad) or NULL, each [n], in;
 * expected, ripple, misaligned, filtered (N m), each [n], out; state [hdb_state_size], in and out.
 * *bad is the index of the offending sample on HDB_ERR_TIME. */
hdb_status hdb_filter_run(const hdb_config *config, double *state, size_t n, const double *time,
                          const double *velocity, const double *torque, const double *angle,
                          double *expected, double *ripple, double *misaligned, double *filtered,
                          size_t *bad);

#endif
