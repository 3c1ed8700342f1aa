/* The samples of one chunk of one trace that has started, P as full rows in vectors of the
 * compiler. A template: define before each inclusion
 *   HDB_ROWS(name)            its names,
 *   HDB_VECTOR                doubles of a vector register,
 *   HDB_SLOTS, HDB_SLOW_SLOTS oscillators and slow torques that it has room for.
 * A model of fewer blocks leaves slots at zero, which changes no bit of any sum. Each number is the
 * same expression as in filter_recursion.h; the diagonal of P is kept apart, rows hold 0 there. */
#define V HDB_VECTOR
#define SLOTS (HDB_SLOTS + HDB_SLOW_SLOTS)
#define N (2 * SLOTS)
#define PARTS ((N + V - 1) / V)
#define WIDE (PARTS * V)
#define EACH_PART HDB_UNROLL for (int m = 0; m < PARTS; ++m)
#define EACH_ROW HDB_UNROLL for (int a = 0; a < N; ++a)
typedef double HDB_ROWS(part) __attribute__((vector_size(V * sizeof(double))));
typedef int64_t HDB_ROWS(index) __attribute__((vector_size(V * sizeof(double))));
#define part_of_row HDB_ROWS(part)
#define OF(array, i) (array)[(i) / V][(i) % V]
#define AT_LANE(array, i) ((double *)(array))[i] /* in memory */
#define EVERYWHERE(x) ((x) - (part_of_row){0}) /* to the bit, as adding 0 is not */

typedef struct {
    part_of_row z[PARTS], d[PARTS], g[PARTS], p[N][PARTS];
    part_of_row inverse, step; /* of the measurement to be done, in every lane */
} HDB_ROWS(filter);
#define filter HDB_ROWS(filter)

typedef struct { /* of one chunk, sample by sample */
    part_of_row c[HDB_CHUNK][PARTS], seen[HDB_CHUNK][PARTS], d[HDB_CHUNK][PARTS];
    part_of_row g[HDB_CHUNK][PARTS];
    double inverse[HDB_CHUNK], worst, least;
} HDB_ROWS(table);
#define table HDB_ROWS(table)

/* The model's block in a slot, or -1. */
HDB_INLINE int HDB_ROWS(block)(const hdb_model *model, int slot)
{
    if (slot < HDB_SLOTS)
        return slot < model->n_oscillators ? slot : -1;
    slot -= HDB_SLOTS;
    return slot < model->n_slow ? model->n_oscillators + slot : -1;
}

HDB_INLINE void HDB_ROWS(unpack)(const hdb_model *model, const lanes *s, filter *f, table *t)
{
    double z[WIDE] = {0}, g[WIDE] = {0}, d[WIDE] = {0}, p[N * WIDE] = {0};
    for (int a = 0; a < N; ++a) {
        const int own = HDB_ROWS(block)(model, a / 2), i = 2 * own + a % 2;
        if (own < 0)
            continue;
        z[a] = s->z[i];
        g[a] = s->g[i];
        d[a] = s->p[AT(i, i)];
        for (int b = 0; b < a; ++b) {
            const int other = HDB_ROWS(block)(model, b / 2), j = 2 * other + b % 2;
            if (other >= 0)
                p[a * WIDE + b] = p[b * WIDE + a] = s->p[AT(i, j)];
        }
    }
    f->inverse = EVERYWHERE(s->head[HDB_INVERSE]);
    f->step = EVERYWHERE(s->head[HDB_STEP]);
    memset(t->c, 0, sizeof t->c);
    for (int i = 0; i < HDB_CHUNK; ++i)
        for (int b = 0; b < model->n_slow && HDB_SLOW_SLOTS > 0; ++b)
            AT_LANE(t->c[i], 2 * (HDB_SLOTS + b)) = 1; /* a slow torque is seen through (1, 0) */
    memcpy(f->z, z, sizeof z);
    memcpy(f->g, g, sizeof g);
    memcpy(f->d, d, sizeof d);
    memcpy(f->p, p, sizeof p);
}

HDB_INLINE void HDB_ROWS(pack)(const hdb_model *model, const filter *f, lanes *s)
{
    double z[WIDE], g[WIDE], d[WIDE], p[N * WIDE];
    s->head[HDB_INVERSE] = f->inverse[0];
    s->head[HDB_STEP] = f->step[0];
    memcpy(z, f->z, sizeof z);
    memcpy(g, f->g, sizeof g);
    memcpy(d, f->d, sizeof d);
    memcpy(p, f->p, sizeof p);
    for (int a = 0; a < N; ++a) {
        const int own = HDB_ROWS(block)(model, a / 2), i = 2 * own + a % 2;
        if (own < 0)
            continue;
        s->z[i] = z[a];
        s->g[i] = g[a];
        s->p[AT(i, i)] = d[a];
        for (int b = 0; b < a; ++b) {
            const int other = HDB_ROWS(block)(model, b / 2), j = 2 * other + b % 2;
            if (other >= 0)
                s->p[AT(i, j)] = p[a * WIDE + b];
        }
    }
}

/* Register by register, so that a copy on the stack is none. */
HDB_INLINE void HDB_ROWS(copy)(const filter *from, filter *to)
{
    to->inverse = from->inverse;
    to->step = from->step;
    EACH_PART {
        to->z[m] = from->z[m];
        to->g[m] = from->g[m];
        to->d[m] = from->d[m];
        HDB_UNROLL
        for (int a = 0; a < N; ++a)
            to->p[a][m] = from->p[a][m];
    }
}

/* Cosine and sine of each slot side by side. */
HDB_INLINE void HDB_ROWS(arrange)(int no, const work *k, int n, table *t)
{
    for (int i = 0; i < n; ++i) {
        HDB_UNROLL
        for (int b = 0; b < no; ++b) {
            const hdb_two two = {k->cosine[b][i], k->sine[b][i]};
            memcpy(&AT_LANE(t->c[i], 2 * b), &two, sizeof two);
        }
    }
}

#if HDB_SLOW_SLOTS > 0
/* z <- F z, g <- F g, P <- F P F' + Q of the slow torque in a slot with the transition t. */
HDB_INLINE void HDB_ROWS(drift)(int slot, const double *t, filter *f)
{
    const int u = 2 * slot, v = u + 1, at = u / V, i = u % V, j = v % V;
    const double p11 = OF(f->d, u), p12 = OF(f->p[u], v), p22 = OF(f->d, v);
    const double t0 = t[0] * p11 + t[1] * p12, t1 = t[0] * p12 + t[1] * p22;
    const double u0 = t[2] * p11 + t[3] * p12, u1 = t[2] * p12 + t[3] * p22;
    part_of_row own = {0}, other = {0};
    own += 1.0;
    own[i] = t[0];
    own[j] = t[3];
    other[i] = t[1];
    other[j] = t[2];
    f->z[at] = f->z[at] * own + HDB_MOVED(f->z[at], HDB_PAIRS) * other;
    f->g[at] = f->g[at] * own + HDB_MOVED(f->g[at], HDB_PAIRS) * other;
    EACH_PART {
        const part_of_row above = f->p[u][m], below = f->p[v][m];
        f->p[u][m] = t[0] * above + t[1] * below;
        f->p[v][m] = t[2] * above + t[3] * below;
    }
    EACH_ROW {
        if (a != u && a != v)
            f->p[a][at] = f->p[a][at] * own + HDB_MOVED(f->p[a][at], HDB_PAIRS) * other;
    }
    f->p[u][at][i] = f->p[v][at][j] = 0;
    f->p[u][at][j] = f->p[v][at][i] = (t0 * t[2] + t1 * t[3]) + t[5];
    f->d[at][i] = (t0 * t[0] + t1 * t[1]) + t[4];
    f->d[at][j] = (u0 * t[2] + u1 * t[3]) + t[6];
}
#endif

/* Sum of the lanes in the order of filter_recursion.h's `along`, in every lane. */
HDB_INLINE part_of_row HDB_ROWS(folded)(const part_of_row *x)
{
    part_of_row sum[8 / V];
    HDB_UNROLL
    for (int m = 0; m < 8 / V; ++m)
        sum[m] = m < PARTS ? x[m] : (part_of_row){0};
    HDB_UNROLL
    for (int m = 8 / V; m < PARTS; ++m)
        sum[m % (8 / V)] += x[m];
#if HDB_VECTOR == 8
    const part_of_row half = sum[0] + HDB_MOVED(sum[0], HDB_HALVES);
    const part_of_row pair = half + HDB_MOVED(half, HDB_QUARTERS);
#elif HDB_VECTOR == 4
    const part_of_row half = sum[0] + sum[1], pair = half + HDB_MOVED(half, HDB_HALVES);
#else
    const part_of_row pair = (sum[0] + sum[2]) + (sum[1] + sum[3]);
#endif
    return pair + HDB_MOVED(pair, HDB_PAIRS);
}

HDB_INLINE part_of_row HDB_ROWS(along)(const part_of_row *c, const part_of_row *x)
{
    part_of_row each[PARTS];
    EACH_PART each[m] = x[m] * c[m];
    return HDB_ROWS(folded)(each);
}

/* Lane `a` of g everywhere, but 0 in lane a itself; all of it of a part that has not this lane. */
HDB_INLINE part_of_row HDB_ROWS(spread)(const part_of_row *g, int a, int m)
{
#if defined(__GNUC__) && !defined(__clang__)
    HDB_ROWS(index) from = {0};
    from += a % V;
    if (a / V == m)
        from[a % V] = V;
    return __builtin_shuffle(g[a / V], (part_of_row){0}, from);
#else
    part_of_row all = {0};
    all += OF(g, a);
    if (a / V == m)
        all[a % V] = 0;
    return all;
#endif
}

/* z <- z + g e / S, P <- P - g g' / S. */
HDB_INLINE void HDB_ROWS(settle)(filter *f)
{
    EACH_PART {
        f->z[m] += f->g[m] * f->step;
        f->d[m] -= f->inverse * (f->g[m] * f->g[m]);
    }
    EACH_ROW {
        EACH_PART f->p[a][m] -= f->inverse * (f->g[m] * HDB_ROWS(spread)(f->g, a, m));
    }
}

/* b = P C'. */
HDB_INLINE void HDB_ROWS(project)(const part_of_row *c, const filter *f, part_of_row *b)
{
    const double *const cs = (const double *)c;
    EACH_PART {
        part_of_row sum = f->d[m] * c[m], rest = {0};
        sum += f->p[0][m] * cs[0] + f->p[1][m] * cs[1];
        HDB_UNROLL
        for (int i = 1; i < SLOTS; ++i) {
            part_of_row more = f->p[2 * i][m] * cs[2 * i];
            more += f->p[2 * i + 1][m] * cs[2 * i + 1];
            rest = i > 1 ? rest + more : more;
        }
        b[m] = sum + rest;
    }
}

typedef struct {
    double used, product, log_sum, squares;
    int since;
} HDB_ROWS(tally);
#define tally HDB_ROWS(tally)

/* What a sample adds to the likelihood. */
HDB_INLINE void HDB_ROWS(count)(tally *sums, int used, double e, double variance, double inverse)
{
    if (HDB_LIKELY(used)) {
        sums->used += 1;
        sums->squares += e * e * inverse;
        sums->product *= variance;
    }
    if (++sums->since < 8)
        return;
    sums->since = 0;
    if (!(sums->product > 1e-150 && sums->product < 1e150)) {
        sums->log_sum += log(sums->product);
        sums->product = 1;
    }
}

/* Sum of what some slots predict of each sample. */
HDB_INLINE void HDB_ROWS(seen)(int count, const int *slots, int n, const table *t, double *sum)
{
    for (int i = 0; i < n; ++i) {
        double all = 0;
        HDB_UNROLL
        for (int m = 0; m < count; ++m)
            all += AT_LANE(t->seen[i], 2 * slots[m]);
        sum[i] = all;
    }
}

/* Variance of a state after sample i. */
HDB_INLINE double HDB_ROWS(left)(const table *t, int i, int a)
{
    const double g = AT_LANE(t->g[i], a);
    return AT_LANE(t->d[i], a) - t->inverse[i] * (g * g);
}

/* What is reported of each sample, once the chunk is done. */
HDB_INLINE void HDB_ROWS(report)(const hdb_model *model, int n, work *k, const table *t)
{
    for (int p = 0; p < 3; ++p) {
        int slots[SLOTS], count = 0;
        for (int b = 0; b < SLOTS; ++b) {
            const int own = HDB_ROWS(block)(model, b);
            if (own >= 0 && model->block[own].part == p)
                slots[count++] = b;
        }
        switch (count) { /* unrolled */
        case 0: HDB_ROWS(seen)(0, slots, n, t, k->part[p]); break;
        case 1: HDB_ROWS(seen)(1, slots, n, t, k->part[p]); break;
        case 2: HDB_ROWS(seen)(2, slots, n, t, k->part[p]); break;
        default: HDB_ROWS(seen)(count, slots, n, t, k->part[p]); break;
        }
    }
    for (int i = 0; i < n; ++i)
        k->filtered[i] = k->torque[i] - (k->part[0][i] + k->part[1][i]);
    if (t->worst <= HDB_RESOLVED * t->least)
        return; /* every block is resolved */
    for (int i = 0; i < n; ++i) {
        const double limit = HDB_RESOLVED * k->variance[i];
        int found = 0;
        HDB_UNROLL
        for (int b = 0; b < HDB_SLOTS; ++b)
            found |= HDB_ROWS(left)(t, i, 2 * b) + HDB_ROWS(left)(t, i, 2 * b + 1) > limit;
        k->flag[i] += found ? HDB_UNRESOLVED : 0;
    }
}

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
        const part_of_row ahead = HDB_ROWS(along)(c, f->g), before = HDB_ROWS(along)(c, f->z);
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

#undef V
#undef SLOTS
#undef N
#undef PARTS
#undef WIDE
#undef EACH_PART
#undef EACH_ROW
#undef part_of_row
#undef OF
#undef AT_LANE
#undef EVERYWHERE
#undef filter
#undef table
#undef tally
