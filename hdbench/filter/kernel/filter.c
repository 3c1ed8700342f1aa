/* One sample at a time, and the check of a model: all that a target needs. */
#ifdef HDB_EXPORTED /* one model that never changes: the compiler knows its numbers */
#include "hdb_model.h"
#endif
#include "filter.h"

#define HDB_IN_PLACE
#define HDB_LANES 1
#define HDB_CHUNK 1
#define HDB_FORM(name) hdb_step_##name
#include "filter_motion.h"
#include "filter_recursion.h"

void hdb_filter_step(const hdb_model *model, hdb_state *state, hdb_real dt, hdb_real velocity,
                     hdb_real torque, hdb_output *out)
{
#ifdef HDB_EXPORTED
    model = &hdb_exported_model;
#endif
    hdb_step_work k;
    const hdb_real time = state->head[HDB_TIME] + dt;
    hdb_step_observe(model, state, &k, 0, time, velocity, torque, HDB_NAN);
    hdb_step_filter(model, state, 1, &k, NULL);
    /* time starts anew at every sample: a float would lose a millisecond within hours */
    state->head[HDB_VELOCITY_TIME] -= time;
    state->head[HDB_TIME] = 0;
    out->expected = k.expected[0];
    out->ripple = k.part[HDB_RIPPLE][0];
    out->misalignment = k.part[HDB_MISALIGNMENT][0];
    out->slow = k.part[HDB_SLOW][0];
    out->filtered = k.filtered[0];
    out->innovation = k.innovation[0];
    out->variance = k.variance[0];
    out->flag = (int)k.flag[0];
}

static int positive(hdb_real value) { return value > 0 && value <= HDB_LARGEST; }

static int at_least_0(hdb_real value) { return value >= 0 && value <= HDB_LARGEST; }

static int block_is_good(const hdb_block *b, int oscillator)
{
    if (b->kind < HDB_OSCILLATOR || b->kind > HDB_RESONANCE || b->part < HDB_RIPPLE ||
        b->part > HDB_SLOW)
        return 0;
    if ((b->kind == HDB_OSCILLATOR) != oscillator || (b->part == HDB_SLOW) == oscillator)
        return 0;
    if (!at_least_0(b->order) || !at_least_0(b->omega) || !at_least_0(b->q_sample) ||
        !at_least_0(b->q_rad) || !at_least_0(b->q_s) || !at_least_0(b->prior[0]) ||
        !at_least_0(b->prior[1]))
        return 0;
    if (oscillator)
        return positive(b->order) != positive(b->omega);
    if (b->kind == HDB_RESONANCE && !(positive(b->order) && positive(b->omega)))
        return 0;
    if (b->kind >= HDB_ORNSTEIN_UHLENBECK)
        return positive(b->rate) && positive(b->variance);
    return 1;
}

hdb_status hdb_model_check(const hdb_model *model)
{
    const int no = model->n_oscillators, nb = no + model->n_slow;
    if (no < 0 || model->n_slow < 0 || nb < 1 || nb > HDB_MAX_BLOCKS)
        return HDB_ERR_CONFIG;
    for (int i = 0; i < nb; ++i)
        if (!block_is_good(&model->block[i], i < no))
            return HDB_ERR_CONFIG;
    if (!positive(model->r) || !positive(model->ratio) || !positive(model->constant) ||
        !at_least_0(model->inertia) || !at_least_0(model->gate) || !(model->gate_samples >= 1))
        return HDB_ERR_CONFIG;
    return HDB_OK;
}
