/* The plain way to trace light through smoke, as a yardstick: analog delta tracking, one thread of control a path, no SIMD.
 *
 *   cc -O3 -march=native -fopenmp -o baseline baseline.c -lm
 *   baseline SETTINGS DENSITY SPP SEED PICTURE
 *
 * SETTINGS is what scenes.py writes: numbers in a fixed order. DENSITY holds voxels as 32-bit floats, x fastest; PICTURE gets
 * grey pixels so, the top row first. Upper bounds are kept for cells of 4 by 4 by 4 voxels. The sun and lamps are asked for a
 * direct connection at each scattering, which is open or not (a flight of its own decides); the sky is what paths meet that
 * escape. Paths have no end but a roulette by their throughput from the 64th scattering on. Prints the seconds of tracing.
 */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { CELL = 4, LAMPS_MAX = 8, ROULETTE_FROM = 64 };

typedef struct { double v[3]; } Vec;

static struct {
    int size[2], dims[3], lamp_count, has_ground, has_ball;
    double low[3], voxel, extinction, albedo, g, sky;
    Vec eye, look_at, to_sun, ball, lamp[LAMPS_MAX];
    double fov, sun, ground_albedo, ball_radius, ball_albedo, intensity[LAMPS_MAX];
} S;
static float *density, *bound;
static int cells[3];

static Vec along(Vec a, double t, Vec b) {
    for (int i = 0; i < 3; i++) a.v[i] += t * b.v[i];
    return a;
}
static double dot(Vec a, Vec b) { return a.v[0] * b.v[0] + a.v[1] * b.v[1] + a.v[2] * b.v[2]; }
static Vec cross(Vec a, Vec b) {
    return (Vec){{a.v[1] * b.v[2] - a.v[2] * b.v[1], a.v[2] * b.v[0] - a.v[0] * b.v[2], a.v[0] * b.v[1] - a.v[1] * b.v[0]}};
}
static Vec unit(Vec a) { return along((Vec){{0}}, 1.0 / sqrt(dot(a, a)), a); }

/* SplitMix64 (Steele, Lea and Flood 2014). */
static double uniform(uint64_t *state) {
    uint64_t z = (*state += 0x9E3779B97F4A7C15u);
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9u;
    z = (z ^ z >> 27) * 0x94D049BB133111EBu;
    return (double)((z ^ z >> 31) >> 11) * 0x1p-53;
}

static double voxel_at(int i, int j, int k) {
    if (i < 0 || j < 0 || k < 0 || i >= S.dims[0] || j >= S.dims[1] || k >= S.dims[2]) return 0.0;
    return density[((size_t)k * S.dims[1] + j) * S.dims[0] + i];
}

/* Between the middles of voxels, p in voxels from the corner of the grid. */
static double density_at(const double p[3]) {
    int low[3];
    double t[3];
    for (int a = 0; a < 3; a++) {
        double x = p[a] - 0.5;
        low[a] = (int)floor(x);
        t[a] = x - low[a];
    }
    double row[4];
    for (int n = 0; n < 4; n++) {
        int j = low[1] + (n & 1), k = low[2] + (n >> 1);
        row[n] = voxel_at(low[0], j, k) * (1.0 - t[0]) + voxel_at(low[0] + 1, j, k) * t[0];
    }
    double near = row[0] * (1.0 - t[1]) + row[1] * t[1], far = row[2] * (1.0 - t[1]) + row[3] * t[1];
    return near * (1.0 - t[2]) + far * t[2];
}

/* Where light that starts at o is stopped by smoke before t_max, or a negative number. */
static double flight(Vec o, Vec d, double t_max, uint64_t *rng) {
    double p[3], step[3], enter = 0.0, leave = t_max;
    for (int a = 0; a < 3; a++) {
        p[a] = (o.v[a] - S.low[a]) / S.voxel;
        step[a] = d.v[a] / S.voxel;
        if (step[a] == 0.0) {
            if (p[a] < 0.0 || p[a] > S.dims[a]) return -1.0;
            continue;
        }
        double one = -p[a] / step[a], other = (S.dims[a] - p[a]) / step[a];
        enter = fmax(enter, fmin(one, other));
        leave = fmin(leave, fmax(one, other));
    }
    if (enter >= leave) return -1.0;
    int cell[3], way[3];
    double next[3];
    for (int a = 0; a < 3; a++) {
        int c = (int)floor((p[a] + enter * step[a]) / CELL);
        cell[a] = c < 0 ? 0 : c >= cells[a] ? cells[a] - 1 : c;
        way[a] = step[a] < 0.0 ? -1 : 1;
        next[a] = step[a] == 0.0 ? INFINITY : ((cell[a] + (way[a] > 0)) * CELL - p[a]) / step[a];
    }
    double t = enter, depth = -log1p(-uniform(rng));
    for (;;) {
        int a = next[0] < next[1] ? 0 : 1;
        if (next[2] < next[a]) a = 2;
        double end = fmin(next[a], leave);
        double most = S.extinction * bound[((size_t)cell[2] * cells[1] + cell[1]) * cells[0] + cell[0]];
        while (depth < most * (end - t)) {
            t += depth / most;
            double at[3] = {p[0] + t * step[0], p[1] + t * step[1], p[2] + t * step[2]};
            if (uniform(rng) * most < S.extinction * density_at(at)) return t;
            depth = -log1p(-uniform(rng));
        }
        depth -= most * fmax(end - t, 0.0);
        t = end;
        if (t >= leave) return -1.0;
        cell[a] += way[a];
        if (cell[a] < 0 || cell[a] >= cells[a]) return -1.0;
        next[a] += CELL / fabs(step[a]);
    }
}

/* The nearest surface: its distance, or infinity; normal and albedo. */
static double surface(Vec o, Vec d, Vec *normal, double *albedo) {
    double t = INFINITY;
    if (S.has_ground && d.v[1] < 0.0 && o.v[1] > 0.0) {
        t = -o.v[1] / d.v[1];
        Vec at = along(o, t, d);
        if (fabs(at.v[0]) > 20.0 || fabs(at.v[2]) > 20.0) t = INFINITY;
        *normal = (Vec){{0.0, 1.0, 0.0}};
        *albedo = S.ground_albedo;
    }
    if (S.has_ball) {
        Vec c = along(o, -1.0, S.ball);
        double b = dot(c, d), root = b * b - dot(c, c) + S.ball_radius * S.ball_radius;
        if (root > 0.0 && -b - sqrt(root) > 1e-9 && -b - sqrt(root) < t) {
            t = -b - sqrt(root);
            *normal = unit(along(c, t, d));
            *albedo = S.ball_albedo;
        }
    }
    return t;
}

static int is_open(Vec o, Vec d, double t_max, uint64_t *rng) {
    Vec n;
    double albedo;
    return surface(o, d, &n, &albedo) >= t_max && flight(o, d, t_max, rng) < 0.0;
}

/* A direction at an angle of the given cosine to w. */
static Vec beside(Vec w, double cosine, double turn) {
    Vec helper = fabs(w.v[0]) < 0.6 ? (Vec){{1.0, 0.0, 0.0}} : (Vec){{0.0, 1.0, 0.0}};
    Vec u = unit(cross(helper, w)), v = cross(w, u);
    double sine = sqrt(fmax(0.0, 1.0 - cosine * cosine));
    return unit(along(along(along((Vec){{0}}, cosine, w), sine * cos(turn), u), sine * sin(turn), v));
}

/* Light scattered towards -d at p, from the sun and the lamps; n is NULL in smoke. */
static double direct(Vec p, Vec d, const Vec *n, uint64_t *rng) {
    double light = 0.0;
    for (int i = -1; i < S.lamp_count; i++) {
        Vec to = i < 0 ? S.to_sun : along(S.lamp[i], -1.0, p);
        double square = i < 0 ? 1.0 : dot(to, to), power = (i < 0 ? S.sun : S.intensity[i]) / square;
        if (power <= 0.0) continue;
        to = unit(to);
        double share;
        if (n) {
            share = fmax(0.0, dot(*n, to)) / M_PI;
        } else {
            double root = 1.0 + S.g * S.g - 2.0 * S.g * dot(d, to);
            share = (1.0 - S.g * S.g) / (4.0 * M_PI * root * sqrt(root));
        }
        if (share > 0.0 && is_open(p, to, i < 0 ? INFINITY : sqrt(square), rng)) light += power * share;
    }
    return light;
}

static double radiance(Vec o, Vec d, uint64_t *rng) {
    double light = 0.0, throughput = 1.0;
    for (int bounce = 0;; bounce++) {
        Vec n;
        double albedo, hit = surface(o, d, &n, &albedo), t = flight(o, d, hit, rng);
        if (t < 0.0 && isinf(hit)) return light + throughput * S.sky;
        if (t >= 0.0) {
            o = along(o, t, d);
            throughput *= S.albedo;
            light += throughput * direct(o, d, NULL, rng);
            double u = uniform(rng), cosine = 1.0 - 2.0 * u;
            if (fabs(S.g) > 1e-6) {
                double q = (1.0 - S.g * S.g) / (1.0 + S.g - 2.0 * S.g * u);
                cosine = (1.0 + S.g * S.g - q * q) / (2.0 * S.g);
            }
            d = beside(d, cosine, 2.0 * M_PI * uniform(rng));
        } else {
            o = along(along(o, hit, d), 1e-9, n);
            throughput *= albedo;
            light += throughput * direct(o, d, &n, rng);
            d = beside(n, sqrt(uniform(rng)), 2.0 * M_PI * uniform(rng));
        }
        if (bounce >= ROULETTE_FROM && throughput < 1.0) {
            if (uniform(rng) >= throughput) return light;
            throughput = 1.0;
        }
    }
}

static void read_vec(FILE *f, double *v, int n) {
    for (int i = 0; i < n; i++)
        if (fscanf(f, "%lf", v + i) != 1) exit(2);
}
static int read_int(FILE *f) {
    int n;
    if (fscanf(f, "%d", &n) != 1) exit(2);
    return n;
}

static void read_settings(FILE *f) {
    for (int i = 0; i < 2; i++) S.size[i] = read_int(f);
    for (int i = 0; i < 3; i++) S.dims[i] = read_int(f);
    read_vec(f, S.low, 3);
    read_vec(f, &S.voxel, 1);
    read_vec(f, &S.extinction, 1), read_vec(f, &S.albedo, 1), read_vec(f, &S.g, 1);
    read_vec(f, S.eye.v, 3), read_vec(f, S.look_at.v, 3), read_vec(f, &S.fov, 1);
    read_vec(f, S.to_sun.v, 3), read_vec(f, &S.sun, 1), read_vec(f, &S.sky, 1);
    S.has_ground = read_int(f), read_vec(f, &S.ground_albedo, 1);
    S.has_ball = read_int(f), read_vec(f, S.ball.v, 3), read_vec(f, &S.ball_radius, 1), read_vec(f, &S.ball_albedo, 1);
    S.lamp_count = read_int(f);
    if (S.lamp_count > LAMPS_MAX) exit(2);
    for (int i = 0; i < S.lamp_count; i++) read_vec(f, S.lamp[i].v, 3), read_vec(f, S.intensity + i, 1);
}

/* Of each cell the largest voxel that any place in it is interpolated from. */
static void make_bounds(void) {
    for (int a = 0; a < 3; a++) cells[a] = (S.dims[a] + CELL - 1) / CELL;
    bound = calloc((size_t)cells[0] * cells[1] * cells[2], sizeof *bound);
    for (int z = 0; z < cells[2]; z++)
        for (int y = 0; y < cells[1]; y++)
            for (int x = 0; x < cells[0]; x++) {
                float most = 0.0f;
                for (int k = -1; k <= CELL; k++)
                    for (int j = -1; j <= CELL; j++)
                        for (int i = -1; i <= CELL; i++)
                            most = fmaxf(most, (float)voxel_at(x * CELL + i, y * CELL + j, z * CELL + k));
                bound[((size_t)z * cells[1] + y) * cells[0] + x] = most;
            }
}

int main(int argc, char **argv) {
    if (argc != 6) return 2;
    FILE *f = fopen(argv[1], "r");
    if (!f) return 2;
    read_settings(f);
    fclose(f);
    size_t count = (size_t)S.dims[0] * S.dims[1] * S.dims[2];
    density = malloc(count * sizeof *density);
    f = fopen(argv[2], "rb");
    if (!f || fread(density, sizeof *density, count, f) != count) return 2;
    fclose(f);
    make_bounds();
    int spp = atoi(argv[3]), width = S.size[0], height = S.size[1];
    uint64_t seed = strtoull(argv[4], NULL, 10);
    S.to_sun = unit(S.to_sun);
    Vec forward = unit(along(S.look_at, -1.0, S.eye)), right = unit(cross(forward, (Vec){{0.0, 1.0, 0.0}}));
    Vec up = cross(right, forward);
    double half = tan(S.fov * M_PI / 360.0);
    float *picture = calloc((size_t)width * height, sizeof *picture);
    struct timespec start, end;
    clock_gettime(CLOCK_MONOTONIC, &start);
#pragma omp parallel for schedule(dynamic, 1)
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            uint64_t rng = (seed * 0x9E3779B97F4A7C15u) ^ ((uint64_t)(y * width + x) << 32);
            uniform(&rng);
            double sum = 0.0;
            for (int i = 0; i < spp; i++) {
                double u = (2.0 * (x + uniform(&rng)) - width) / height, v = 1.0 - 2.0 * (y + uniform(&rng)) / height;
                sum += radiance(S.eye, unit(along(along(forward, u * half, right), v * half, up)), &rng);
            }
            picture[(size_t)y * width + x] = (float)(sum / spp);
        }
    clock_gettime(CLOCK_MONOTONIC, &end);
    f = fopen(argv[5], "wb");
    if (!f || fwrite(picture, sizeof *picture, (size_t)width * height, f) != (size_t)width * height || fclose(f)) return 3;
    printf("%.6f\n", (double)(end.tv_sec - start.tv_sec) + 1e-9 * (double)(end.tv_nsec - start.tv_nsec));
    return 0;
}
