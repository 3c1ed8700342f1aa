/* Filter model, fixed at compile time. Written by `hdbench export`; do not edit.
@PROVENANCE@
 * Build with -DHDB_DOUBLE for double; else every number is a float. */
#ifndef HDB_MODEL_H
#define HDB_MODEL_H

#ifndef HDB_DOUBLE
#define HDB_SINGLE
#endif
#define HDB_N_OSCILLATORS @OSCILLATORS@
#define HDB_N_SLOW @SLOW@
#define HDB_MAX_BLOCKS @BLOCKS@
#define HDB_MAX_SLOW @MAX_SLOW@
#define HDB_SAMPLE_PERIOD_S (@PERIOD@)
#include <math.h>

#include "filter.h"

static const hdb_model hdb_exported_model = {
    .n_oscillators = @OSCILLATORS@, .n_slow = @SLOW@,
    .r = @R@, /* (N m)^2 */
    .inertia = @INERTIA@, /* kg m^2 */
    .ratio = @RATIO@,
    .constant = @CONSTANT@, /* s */
    .gate = @GATE@, .gate_samples = @GATE_SAMPLES@,
    .prior_start = @PRIOR_START@,
    .block = {
@BLOCK_ROWS@
    },
};

#endif
