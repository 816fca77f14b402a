"""What a block of threads on a GPU does to one clip's equations, in CUDA: see `conjugate_gradients`.

Both forms run the same iterations in the same order. Text, not functions: Warp compiles it where a GPU is.
"""

THREADS = 1024  # of a clip's block
EACH = 3  # vertices a thread holds
MOST_HELD = EACH * THREADS  # vertices of a garment that a block holds beside its threads

_BLOCK = """
    const int n = start.shape[0] - 1, width = column.shape[0] / n;
    const int t = threadIdx.x, threads = blockDim.x;
    const long first = (long)clip * n;
    const auto* j = column.data;
    const float* a = value.data;
    const wp::mat33 *H = contact.data + first, *M = inverse.data + first;
    __shared__ float parts[32];
    // a vector's fourth number says whether its vertex touches the body: the others' blocks are one number
    auto times = [](const wp::mat33& m, float4 v) {
        return make_float4(m.data[0][0] * v.x + m.data[0][1] * v.y + m.data[0][2] * v.z,
                           m.data[1][0] * v.x + m.data[1][1] * v.y + m.data[1][2] * v.z,
                           m.data[2][0] * v.x + m.data[2][1] * v.y + m.data[2][2] * v.z, v.w);
    };
    auto scaled = [](float s, float4 v) { return make_float4(s * v.x, s * v.y, s * v.z, v.w); };
    auto plus = [](float4 v, float s, float4 w) {
        return make_float4(v.x + s * w.x, v.y + s * w.y, v.z + s * w.z, v.w);
    };
    auto dot = [](float4 v, float4 w) { return v.x * w.x + v.y * w.y + v.z * w.z; };
    auto ratio = [](float s, float t) { return t > 1e-30f || t < -1e-30f ? s / t : 0.0f; };
    auto conditioned = [=](float4 v, int i) {
        const float d = diagonal.data[i];
        return v.w != 0.0f ? times(M[i], v) : scaled(d > 0.0f ? 1.0f / d : 0.0f, v);
    };
    auto total = [&](float sum) {  // of all threads, in the same order always, and known to all
        for (int d = 16; d; d >>= 1) sum += __shfl_xor_sync(0xffffffffu, sum, d);
        __syncthreads();
        if (t % 32 == 0) parts[t / 32] = sum;
        __syncthreads();
        sum = t % 32 < threads / 32 ? parts[t % 32] : 0.0f;
        for (int d = 16; d; d >>= 1) sum += __shfl_xor_sync(0xffffffffu, sum, d);
        return sum;
    };
    auto given = [=](int i) {
        const auto& b = right.data[first + i];
        const float touches = H[i].data[0][0] + H[i].data[1][1] + H[i].data[2][2];
        return make_float4(b[0], b[1], b[2], touches);
    };
    auto begun = [=](int i) {
        const auto& s = solution.data[first + i];
        return warm ? make_float4(s[0], s[1], s[2], 0.0f) : make_float4(0.0f, 0.0f, 0.0f, 0.0f);
    };
"""
# p, which all threads read from everywhere, lies beside them, the rest in registers, `EACH` vertices each:
# an iteration reads the matrix from farther away and nothing else
HELD = (
    _BLOCK
    + f"    constexpr int EACH = {EACH}, MOST = {MOST_HELD};\n"
    + """
    __shared__ float px[MOST], py[MOST], pz[MOST];
    float3 x[EACH], r[EACH], q[EACH];  // q: A p, then the preconditioned residual
    float touches[EACH];
    auto flagged = [&](float3 v, int e) {
        return make_float4(v.x, v.y, v.z, touches[e]);
    };
    auto bare = [](float4 v) { return make_float3(v.x, v.y, v.z); };
    auto own = [&](int i) { return make_float3(px[i], py[i], pz[i]); };
    auto put = [&](int i, float3 v) { px[i] = v.x, py[i] = v.y, pz[i] = v.z; };
    auto add = [](float3& v, float s, float3 w) { v.x += s * w.x, v.y += s * w.y, v.z += s * w.z; };
    auto inner = [](float3 v, float3 w) { return v.x * w.x + v.y * w.y + v.z * w.z; };
    auto multiply = [&](int i, int e) {
        const float4 v = flagged(own(i), e);
        float3 sum = bare(scaled(diagonal.data[i], v));
        if (v.w != 0.0f) add(sum, 1.0f, bare(times(H[i], v)));
#pragma unroll 2
        for (int k = i; k < width * n; k += n) add(sum, a[k], own(j[k]));
        return sum;
    };
#define FOR_EACH _Pragma("unroll") for (int e = 0, i = t; e < EACH; ++e, i += threads) if (i < n)
    FOR_EACH {
        const float4 b = given(i);
        touches[e] = b.w;
        r[e] = bare(b);
        x[e] = bare(begun(i));
        put(i, x[e]);
    }
    __syncthreads();
    if (warm) FOR_EACH add(r[e], -1.0f, multiply(i, e));
    __syncthreads();
    float sum = 0.0f;
    FOR_EACH {
        q[e] = bare(conditioned(flagged(r[e], e), i));
        put(i, q[e]);
        sum += inner(r[e], q[e]);
    }
    float rz = total(sum);
    for (int step = 0; step < iterations; ++step) {
        sum = 0.0f;
        FOR_EACH {
            q[e] = multiply(i, e);
            sum += inner(own(i), q[e]);
        }
        const float alpha = ratio(rz, total(sum)), before = rz;
        sum = 0.0f;
        FOR_EACH {
            add(x[e], alpha, own(i));
            add(r[e], -alpha, q[e]);
            q[e] = bare(conditioned(flagged(r[e], e), i));
            sum += inner(r[e], q[e]);
        }
        rz = total(sum);
        const float beta = ratio(rz, before);
        FOR_EACH {
            add(q[e], beta, own(i));
            put(i, q[e]);
        }
        __syncthreads();
    }
    FOR_EACH solution.data[first + i] = wp::vec3(x[e].x, x[e].y, x[e].z);
#undef FOR_EACH
"""
)
STREAMED = (
    _BLOCK
    + """
    float4 *x = (float4*)work.data + 10 * first, *r = x + n, *p = r + n, *Ap = p + n;
    auto multiply = [=](const float4* v, int i) {
        const float4 own = v[i];
        float4 sum = scaled(diagonal.data[i], own);
        if (own.w != 0.0f) sum = plus(sum, 1.0f, times(H[i], own));
#pragma unroll 4
        for (int k = i; k < width * n; k += n) sum = plus(sum, a[k], v[j[k]]);
        return sum;
    };
    for (int i = t; i < n; i += threads) {
        r[i] = given(i);
        x[i] = begun(i);
        x[i].w = r[i].w;
    }
    __syncthreads();
    float sum = 0.0f;
    for (int i = t; i < n; i += threads) {
        if (warm) r[i] = plus(r[i], -1.0f, multiply(x, i));
        p[i] = conditioned(r[i], i);
        sum += dot(r[i], p[i]);
    }
    float rz = total(sum);
    for (int step = 0; step < iterations; ++step) {
        sum = 0.0f;
        for (int i = t; i < n; i += threads) {
            Ap[i] = multiply(p, i);
            sum += dot(p[i], Ap[i]);
        }
        const float alpha = ratio(rz, total(sum)), before = rz;
        sum = 0.0f;
        for (int i = t; i < n; i += threads) {
            x[i] = plus(x[i], alpha, p[i]);
            r[i] = plus(r[i], -alpha, Ap[i]);
            Ap[i] = conditioned(r[i], i);
            sum += dot(r[i], Ap[i]);
        }
        rz = total(sum);
        const float beta = ratio(rz, before);
        for (int i = t; i < n; i += threads) p[i] = plus(Ap[i], beta, p[i]);
        __syncthreads();
    }
    for (int i = t; i < n; i += threads) solution.data[first + i] = wp::vec3(x[i].x, x[i].y, x[i].z);
"""
)
