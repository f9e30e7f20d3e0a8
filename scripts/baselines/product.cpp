// q = A p, matrix-free, by elements: the scalar C++ and OpenMP baseline of bench_baseline.py.
//
// Triangles hold the symmetric 6x6 block of A in their two edges (21 numbers), hinges the vector g of g g^T in their
// three arms (9 numbers). Each thread owns a run of vertices and goes through the elements that touch it; elements on
// a border are gone through by both and each adds to its own rows only. REAL is float or double.

#include <chrono>
#include <cstdint>
#ifndef REAL
#define REAL double
#endif

struct Vec { REAL x, y, z; };
static inline Vec sub(Vec a, Vec b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
static inline Vec add(Vec a, Vec b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
static inline Vec sym(const REAL* m, Vec v) {
    return {m[0] * v.x + m[1] * v.y + m[2] * v.z, m[1] * v.x + m[3] * v.y + m[4] * v.z, m[2] * v.x + m[4] * v.y + m[5] * v.z};
}
static inline Vec full(const REAL* m, Vec v) {
    return {m[0] * v.x + m[1] * v.y + m[2] * v.z, m[3] * v.x + m[4] * v.y + m[5] * v.z, m[6] * v.x + m[7] * v.y + m[8] * v.z};
}
static inline Vec transposed(const REAL* m, Vec v) {
    return {m[0] * v.x + m[3] * v.y + m[6] * v.z, m[1] * v.x + m[4] * v.y + m[7] * v.z, m[2] * v.x + m[5] * v.y + m[8] * v.z};
}
static inline void put(Vec* q, int32_t i, Vec v, int32_t lo, int32_t hi, REAL s) {
    if (i >= lo && i < hi) q[i] = {q[i].x + s * v.x, q[i].y + s * v.y, q[i].z + s * v.z};
}

extern "C" double product(int32_t blocks, const int32_t* row, const REAL* mass, const int32_t* first_triangle,
                          const int32_t* triangle, const REAL* A, const int32_t* first_hinge, const int32_t* hinge,
                          const REAL* g, const REAL* p_in, REAL* q_out, int32_t repeat) {
    const Vec* p = reinterpret_cast<const Vec*>(p_in);
    Vec* q = reinterpret_cast<Vec*>(q_out);
    const auto start = std::chrono::steady_clock::now();
    for (int32_t k = 0; k < repeat; ++k) {
        #pragma omp parallel for schedule(static, 1)
        for (int32_t b = 0; b < blocks; ++b) {
            const int32_t lo = row[b], hi = row[b + 1];
            for (int32_t i = lo; i < hi; ++i) q[i] = {mass[i] * p[i].x, mass[i] * p[i].y, mass[i] * p[i].z};
            for (int32_t e = first_triangle[b]; e < first_triangle[b + 1]; ++e) {
                const int32_t* v = triangle + 3 * e;
                const REAL* a = A + 21 * static_cast<int64_t>(e);
                const Vec d = sub(p[v[1]], p[v[0]]), f = sub(p[v[2]], p[v[0]]);
                const Vec r = add(sym(a, d), full(a + 6, f)), s = add(transposed(a + 6, d), sym(a + 15, f));
                put(q, v[0], add(r, s), lo, hi, -1);
                put(q, v[1], r, lo, hi, 1);
                put(q, v[2], s, lo, hi, 1);
            }
            for (int32_t e = first_hinge[b]; e < first_hinge[b + 1]; ++e) {
                const int32_t* v = hinge + 4 * e;
                const REAL* c = g + 9 * static_cast<int64_t>(e);
                REAL along = 0;
                for (int a = 0; a < 3; ++a) {
                    const Vec d = sub(p[v[a + 1]], p[v[0]]);
                    along += c[3 * a] * d.x + c[3 * a + 1] * d.y + c[3 * a + 2] * d.z;
                }
                Vec sum = {0, 0, 0};
                for (int a = 0; a < 3; ++a) {
                    const Vec part = {c[3 * a], c[3 * a + 1], c[3 * a + 2]};
                    sum = add(sum, part);
                    put(q, v[a + 1], part, lo, hi, along);
                }
                put(q, v[0], sum, lo, hi, -along);
            }
        }
    }
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() / repeat;
}
