/* Arrays of samples on the host: run, batch, smooth (see filter.h for the model and ownership).
 *
 * Times are in s, finite and increasing; velocity rad/s; torque N m; angle rad, unwrapped, or NULL.
 * On HDB_ERR_TIME *bad is the offending sample and nothing was touched. */
#ifndef HDBENCH_FILTER_HOST_H
#define HDBENCH_FILTER_HOST_H

#include "filter.h"

#define HDB_BATCH_LANES 8
#define HDB_MODEL_HEADER 9
#define HDB_MODEL_BLOCK 11

typedef struct { /* each [n], or [n * n_traces] in a batch with one trace per column */
    const double *time, *velocity, *torque, *angle; /* time is [n] in a batch too */
} hdb_samples;

typedef struct { /* each [n]; N m, variance (N m)^2 */
    double *expected, *ripple, *misalignment, *slow, *filtered, *innovation, *variance;
    uint8_t *flag;
} hdb_outputs;

/* Read [HDB_MODEL_HEADER + HDB_MODEL_BLOCK * n_blocks] numbers: n_oscillators, n_slow, R, J, N, T,
 * gate, gate_samples, prior_start; then per block kind, part, order, omega, q_sample, q_rad, q_s,
 * rate, variance, prior[2]. */
hdb_status hdb_model_read(hdb_model *model, const double *numbers, size_t size);

/* Filter n samples. state [HDB_STATE_SIZE] is in and out. sums [3], out: number of samples used,
 * sum of log S, sum of e^2 / S. */
hdb_status hdb_filter_run(const hdb_model *model, double *state, size_t n,
                          const hdb_samples *samples, const hdb_outputs *out, double *sums,
                          size_t *bad);

/* Filter n_traces traces from their start, each with the bits of hdb_filter_run. filtered,
 * innovation, variance [n * n_traces] out, the last two or NULL; sums [3 * n_traces]. */
hdb_status hdb_filter_batch(const hdb_model *model, size_t n, size_t n_traces,
                            const hdb_samples *samples, const hdb_outputs *out, double *sums,
                            size_t *bad);

/* Numbers that hdb_filter_smooth needs as scratch for n samples. */
size_t hdb_smooth_scratch(const hdb_model *model, size_t n);

/* Fixed-interval smoother (modified Bryson-Frazier). expected [n], mean [n * 2 n_blocks] and
 * covariance [n * 3 n_blocks] (p11, p12, p22 of each block) or NULL, out; NaN before the start. */
hdb_status hdb_filter_smooth(const hdb_model *model, size_t n, const hdb_samples *samples,
                             double *expected, double *mean, double *covariance, double *scratch,
                             size_t *bad);

#endif
