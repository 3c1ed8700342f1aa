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

#ifdef HDB_SUMS
#if HDB_LANES == 1
/* The same for n samples of which none is missing, after one of which nothing was; 0 where this
 * does not hold, and nothing was touched. */
HDB_INLINE int HDB_FORM(observe_all)(const hdb_model *model, lanes *s, work *k, int n,
                                     const double *t, const double *v, const double *y,
                                     const double *a)
{
    double *const head = s->head, scale[HDB_CHUNK], turn[HDB_CHUNK];
    const double two_t = 2.0 * model->constant;
    int bad = 0;
    if (n < 1 || !(head[HDB_SEEN] > 0 && head[HDB_HAS_VELOCITY] > 0) ||
        (head[HDB_HAS_ANGLE] > 0) != (a != NULL) || head[HDB_VELOCITY_TIME] < head[HDB_TIME])
        return 0;
    k->dt[0] = t[0] - head[HDB_TIME];
    for (int i = 1; i < n; ++i)
        k->dt[i] = t[i] - t[i - 1];
    turn[0] = a == NULL ? head[HDB_VELOCITY] * k->dt[0] : a[0] - head[HDB_ANGLE];
    if (a == NULL)
        for (int i = 1; i < n; ++i)
            turn[i] = v[i - 1] * k->dt[i];
    else
        for (int i = 1; i < n; ++i) {
            turn[i] = a[i] - a[i - 1];
            bad |= !(hdb_abs(a[i]) <= HDB_USABLE);
        }
    if (a != NULL)
        bad |= !(hdb_abs(a[0]) <= HDB_USABLE);
    for (int i = 0; i < n; ++i) {
        bad |= !(hdb_abs(v[i]) <= HDB_USABLE) | !(hdb_abs(y[i]) <= HDB_USABLE) |
               !(hdb_abs(turn[i]) <= HDB_LARGEST);
        k->turn[i] = turn[i];
        k->torque[i] = y[i];
    }
    if (bad)
        return 0;
    for (int i = 0; i < n; ++i)
        scale[i] = 1.0 / (two_t + k->dt[i]);
    k->expected[0] = 2.0 * scale[0] * (v[0] - head[HDB_VELOCITY]);
    for (int i = 1; i < n; ++i)
        k->expected[i] = 2.0 * scale[i] * (v[i] - v[i - 1]);
    for (int i = 0; i < n; ++i)
        scale[i] = (two_t - k->dt[i]) * scale[i];
    double now = head[HDB_ACCELERATION];
    for (int i = 0; i < n; ++i)
        k->expected[i] = now = k->expected[i] + scale[i] * now;
    for (int i = 0; i < n; ++i) {
        k->expected[i] = model->inertia * k->expected[i] / model->ratio;
        k->residual[i] = y[i] - k->expected[i];
    }
    head[HDB_TIME] = head[HDB_VELOCITY_TIME] = t[n - 1];
    head[HDB_VELOCITY] = v[n - 1];
    head[HDB_ACCELERATION] = now;
    if (a != NULL)
        head[HDB_ANGLE] = a[n - 1];
    return 1;
}
#endif
#endif
