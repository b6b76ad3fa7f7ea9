/* The steps of the delaminated beam's full kernel (calib/simulators/delaminated_beam/explicit) in C: the same arrays
   and the same operations, without laws, arches, lagged or unclipped dampers and notes. The bench compiles it. */

#include <math.h>
#include <stddef.h>

#define ROW 1032
#define FACTORS 11
#define FORCES 8
#define AROUND 8
#define WATCH 64

typedef struct {
    long size, strips, lines, stretches, pairs, driven;
    const long *strip, *line, *shared, *joint, *slave, *master, *following;
    const unsigned char *acting;
    const double *factors, *across, *inverse_mass, *weight, *clearance, *stiffness, *damping;
    double shear, mean, alpha, beta, step, limit;
} Plan;

typedef struct {
    double *w, *v, *elastic, *gap, *rate, *push, *mobility, *crowd;
    long *active, *count;
} State;

static void forces_of_strip(long count, const double *restrict xl, const double *restrict yl, const double *restrict xu,
                            const double *restrict yu, const double *restrict k, double across, double mean, double shear,
                            double *restrict out) {
    for (long j = 0; j < count; j++) {
        double px = xl[j + 1] - xl[j], qx = xu[j + 1] - xu[j], rx = xu[j] - xl[j];
        double py = yl[j + 1] - yl[j], qy = yu[j + 1] - yu[j], ry = yu[j] - yl[j];
        double hx = qx - px, hy = qy - py;
        double along = k[j], end = k[ROW + j], side = k[2 * ROW + j];
        double g11 = along * (px + qx), g21 = along * (py + qy);
        double g12 = across * (2.0 * rx + hx), g22 = across * (2.0 * ry + hy);
        double a = 2.0 + (g11 + g22), b = g21 - g12;
        double q = 1.0 / sqrt(a * a + b * b);
        double c = a * q, s = b * q, pressure = mean - 2.0 * mean * q;
        double pa = pressure * a, pb = pressure * b, pd = shear * (g11 - g22), ps = shear * (g21 + g12);
        double tx = c * hx + s * hy, ty = c * hy - s * hx;
        double bx = k[3 * ROW + j] * tx, by = k[4 * ROW + j] * ty;
        double moment = (bx * ty - by * tx) * q, mc = moment * c, ms = moment * s;
        double ax = end * (pa + pd) - ms * along, ay = end * (ps + pb) + mc * along;
        double cx = side * (ps - pb) - mc * across, cy = side * (pa - pd) - ms * across;
        double fx = c * bx - s * by, fy = s * bx + c * by;
        double plus = ax + cx, minus = ax - cx;
        out[j] = fx - plus;
        out[ROW + 1 + j] = minus - fx;
        out[4 * ROW + j] = -minus - fx;
        out[5 * ROW + 1 + j] = fx + plus;
        plus = ay + cy;
        minus = ay - cy;
        out[2 * ROW + j] = fy - plus;
        out[3 * ROW + 1 + j] = minus - fy;
        out[6 * ROW + j] = -minus - fy;
        out[7 * ROW + 1 + j] = fy + plus;
    }
}

static void elastic(const Plan *p, const double *w, double *out) {
    for (long n = 0; n < p->strips; n++) {
        const double *low = w + p->strip[3 * n], *up = w + p->strip[3 * n + 1];
        forces_of_strip(p->strip[3 * n + 2], low, low + p->size, up, up + p->size, p->factors + n * FACTORS * ROW,
                        p->across[n], p->mean, p->shear, out + n * FORCES * ROW);
    }
    double *below = out + p->joint[0] * FORCES * ROW, *above = out + p->joint[1] * FORCES * ROW;
    for (long n = 0; n < p->stretches; n++) {
        const long *shared = p->shared + 3 * n;
        for (long row = 0; row <= 2; row += 2) {
            double *restrict mine = above + row * ROW + shared[0];
            const double *restrict other = below + (row + 4) * ROW + shared[1];
            for (long j = 0; j < shared[2]; j++) mine[j] += other[j] + other[ROW + j];
        }
    }
}

static void advance_outer_line(long count, const double *restrict f, double *restrict w, double *restrict v,
                               const double *restrict inverse_mass, double keep, double gain, double ahead, double back) {
    for (long j = 0; j < count; j++) {
        double old = v[j], new = keep * old - gain * inverse_mass[j] * (f[j] + f[ROW + j]);
        v[j] = new;
        w[j] += ahead * new - back * old;
    }
}

static void advance_inner_line(long count, const double *restrict below, const double *restrict above,
                               double *restrict w, double *restrict v, const double *restrict inverse_mass, double keep,
                               double gain, double ahead, double back) {
    for (long j = 0; j < count; j++) {
        double old = v[j], force = below[j] + below[ROW + j] + above[j] + above[ROW + j];
        double new = keep * old - gain * inverse_mass[j] * force;
        v[j] = new;
        w[j] += ahead * new - back * old;
    }
}

static void advance_nodes(const Plan *p, State *s) {
    double half = 0.5 * p->alpha * p->step, keep = (1.0 - half) / (1.0 + half), gain = p->step / (1.0 + half);
    double ahead = p->step + p->beta, back = p->beta;
    for (long n = 0; n < p->lines; n++) {
        const long *line = p->line + 4 * n;
        for (long component = 0; component < 2; component++) {
            long at = line[0] + component * p->size;
            const double *lower = s->elastic + (line[2] * FORCES + 4 + 2 * component) * ROW;
            const double *upper = s->elastic + (line[3] * FORCES + 2 * component) * ROW;
            const double *mass = p->inverse_mass + at;
            if (line[2] >= 0 && line[3] >= 0)
                advance_inner_line(line[1], lower, upper, s->w + at, s->v + at, mass, keep, gain, ahead, back);
            else
                advance_outer_line(line[1], line[3] >= 0 ? upper : lower, s->w + at, s->v + at, mass, keep, gain, ahead,
                                   back);
        }
    }
}

static long find_contact(const Plan *p, State *s, double *nearest) {
    long closed = 0;
    *nearest = INFINITY;
    for (long i = 0; i < p->pairs; i++) {
        if (!p->acting[i]) continue;
        long a = p->slave[i], m = p->master[i], n = p->following[i];
        double weight = p->weight[i];
        double rate = s->v[a] - (1.0 - weight) * s->v[m] - weight * s->v[n];
        double gap = p->clearance[i] + s->w[a] - (1.0 - weight) * s->w[m] - weight * s->w[n] - p->beta * rate;
        if (gap < *nearest) *nearest = gap;
        if (gap < 0.0) {
            s->active[closed] = i;
            s->gap[closed] = gap;
            s->rate[closed++] = rate;
        }
    }
    return closed;
}

static void push_apart(const Plan *p, State *s, long closed) {
    double gain = p->step / (1.0 + 0.5 * p->alpha * p->step), ahead = p->step + p->beta;
    const double *inverse = p->inverse_mass;
    for (long k = 0; k < closed; k++) {
        long i = s->active[k];
        s->crowd[p->master[i]] += 1.0 - p->weight[i];
        s->crowd[p->following[i]] += p->weight[i];
    }
    for (long k = 0; k < closed; k++) {
        long i = s->active[k], a = p->slave[i], m = p->master[i], n = p->following[i];
        double weight = p->weight[i], free = s->v[a] - (1.0 - weight) * s->v[m] - weight * s->v[n];
        double mobility = inverse[a] + (1.0 - weight) * inverse[m] * s->crowd[m] + weight * inverse[n] * s->crowd[n];
        double push = -p->stiffness[i] * s->gap[k] - p->damping[i] * 0.5 * (s->rate[k] + free);
        push /= 1.0 + 0.5 * p->damping[i] * gain * mobility;
        s->push[k] = push > 0.0 ? push : 0.0;
    }
    for (long k = 0; k < closed; k++) {
        long i = s->active[k], node[3] = {p->slave[i], p->master[i], p->following[i]};
        double part[3] = {1.0, p->weight[i] - 1.0, -p->weight[i]};
        s->crowd[node[1]] = s->crowd[node[2]] = 0.0;
        for (int j = 0; j < 3; j++) {
            double change = gain * inverse[node[j]] * part[j] * s->push[k];
            s->v[node[j]] += change;
            s->w[node[j]] += ahead * change;
        }
    }
}

int advance(const Plan *p, State *s, const double *drive, long steps) {
    long layer = p->line[4 * p->joint[2]], beam = p->line[4 * (p->joint[2] - 1)];
    for (long n = 0; n < steps; n++) {
        long closed = 0;
        if (s->count[0] >= s->count[1]) {
            double nearest;
            closed = find_contact(p, s, &nearest);
            if (!closed && nearest > 2.0 * AROUND * p->step * p->limit) s->count[1] = s->count[0] + AROUND;
        }
        elastic(p, s->w, s->elastic);
        double before = s->w[p->driven] - p->beta * s->v[p->driven];
        advance_nodes(p, s);
        s->v[p->driven] = (drive[n] - before) / p->step;
        s->w[p->driven] = drive[n] + p->beta * s->v[p->driven];
        if (closed) push_apart(p, s, closed);
        for (long k = 0; k < p->stretches; k++)
            for (long component = 0; component < 2; component++) {
                long source = component * p->size + layer + p->shared[3 * k];
                long copy = component * p->size + beam + p->shared[3 * k + 1];
                for (long j = 0; j < p->shared[3 * k + 2]; j++) {
                    s->w[copy + j] = s->w[source + j];
                    s->v[copy + j] = s->v[source + j];
                }
            }
        s->count[0]++;
        if (s->count[0] % WATCH == 0)
            for (long j = 0; j < 2 * p->size; j++)
                if (!(fabs(s->v[j]) < p->limit)) return 1;
    }
    return 0;
}
