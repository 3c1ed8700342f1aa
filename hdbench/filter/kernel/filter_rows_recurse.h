/* The recursion with P in rows. Part of the template of filter_rows.h. */

/* Process noise of the oscillators: per sample, per rad, per s. */
HDB_INLINE int HDB_ROWS(stirring)(const hdb_model *model, part_of_row (*noise)[PARTS])
{
    int steady = 1;
    memset(noise, 0, 3 * sizeof *noise);
    for (int a = 0; a < 2 * HDB_SLOTS; ++a) {
        const int b = HDB_ROWS(block)(model, a / 2);
        if (b < 0)
            continue;
        OF(noise[0], a) = model->block[b].q_sample;
        OF(noise[1], a) = model->block[b].q_rad;
        OF(noise[2], a) = model->block[b].q_s;
        steady = steady && !(model->block[b].q_rad > 0 || model->block[b].q_s > 0);
    }
    return steady;
}

HDB_APART void HDB_ROWS(recurse)(const hdb_model *model, lanes *s, filter *kept, table *t, int n,
                                   work *k)
{
    filter own, *const f = &own;
    tally sums = {s->used, s->product, s->log_sum, s->squares, s->since};
    const double inertia = model->inertia / model->ratio;
    double acceleration = s->head[HDB_ACCELERATION], least = DBL_MAX;
    part_of_row each[3][PARTS], grown[PARTS], first[PARTS];
    double gated = s->head[HDB_GATED_RUN];
    const int steady = HDB_ROWS(stirring)(model, each), gating = model->gate > 0;
    if (model->n_oscillators == 3)
        HDB_ROWS(arrange)(3, k, n, t);
    else
        HDB_ROWS(arrange)(model->n_oscillators, k, n, t);
    HDB_ROWS(copy)(kept, f);
    double inverse = f->inverse[0];
    EACH_PART {
        first[m] = f->d[m];
        grown[m] = steady ? each[0][m] * (double)n : (part_of_row){0};
    }
    for (int i = 0; i < n; ++i) {
        const part_of_row *const c = t->c[i];
        double residual = k->residual[i];
        if (k->coasting) {
            acceleration = k->push[i] + k->carry[i] * acceleration;
            k->expected[i] = inertia * acceleration;
            residual = k->torque[i] - k->expected[i];
        }
        part_of_row b[PARTS];
#if HDB_SLOW_SLOTS > 0
        HDB_UNROLL
        for (int slow = 0; slow < HDB_SLOW_SLOTS; ++slow) {
            if (slow < model->n_slow)
                HDB_ROWS(drift)(HDB_SLOTS + slow, k->f[slow][i], f);
        }
#endif
        EACH_PART {
            part_of_row noise = each[0][m];
            if (!steady)
                noise = (noise + each[1][m] * hdb_abs(k->turn[i])) + each[2][m] * k->dt[i];
            if (!steady)
                grown[m] += noise;
            f->d[m] += noise;
        }
        part_of_row ahead, before;
        HDB_ROWS(both)(c, f->g, f->z, &ahead, &before);
        const part_of_row innovation = (residual - before) - ahead * f->step;
        HDB_ROWS(project)(c, f, b);
        const double fw = ahead[0] * inverse; /* twice: what 1/S waits for is no vector */
        const double variance = model->r + (HDB_ROWS(along)(c, b)[0] - ahead[0] * fw);
        const double e = innovation[0];
        HDB_ROWS(settle)(f);
        EACH_PART {
            const part_of_row seen = f->z[m] * c[m];
            t->seen[i][m] = seen + HDB_MOVED(seen, HDB_PAIRS); /* both states of a slot */
            f->g[m] = b[m] - f->g[m] * (ahead * f->inverse);
        }
        int flag = residual == residual ? 0 : HDB_MISSING;
        inverse = 1.0 / variance;
        f->inverse = EVERYWHERE(inverse);
        if (gating && !flag) {
            const int beyond = e * e > model->gate * variance && gated < model->gate_samples;
            flag = beyond ? HDB_GATED : 0;
            gated = beyond ? gated + 1 : 0;
        }
        f->step = f->inverse * innovation;
        if (HDB_RARELY(flag)) {
            inverse = 0;
            f->inverse = f->step = (part_of_row){0};
        }
        EACH_PART {
            t->d[i][m] = f->d[m];
            t->g[i][m] = f->g[m];
        }
        k->innovation[i] = e;
        k->variance[i] = variance;
        k->flag[i] = flag;
        least = variance < least ? variance : least;
        HDB_ROWS(count)(&sums, !flag, e, variance, inverse);
        t->inverse[i] = inverse;
    }
    t->worst = 0; /* a bound of every sum of two */
    for (int a = 0; a < 2 * HDB_SLOTS; ++a) {
        const double most = 2 * (OF(first, a) + OF(grown, a));
        t->worst = most > t->worst ? most : t->worst;
    }
    HDB_ROWS(copy)(f, kept);
    t->least = least;
    s->head[HDB_GATED_RUN] = gated;
    s->head[HDB_ACCELERATION] = acceleration;
    s->used = sums.used;
    s->product = sums.product;
    s->log_sum = sums.log_sum;
    s->squares = sums.squares;
    s->since = sums.since;
    HDB_ROWS(report)(model, n, k, t);
}
