/* Motion of the samples: turn, time, expected torque. Part of the template of filter_lanes.h. */

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
