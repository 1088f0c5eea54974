// Inverses as a GPU wants them: a work-group a matrix, the panel in local memory. The same steps as `invert`, but for
// singular matrices, which are gone through to the end: every work-item meets every barrier.

#define GPU_CREW 256        // work-items of a group

// M <- M^-1; arguments as those of `invert`, and panel (n, width) in local memory. Global size: 256 a matrix.
__attribute__((reqd_work_group_size(GPU_CREW, 1, 1)))
__kernel void invert_gpu(int n, __global double* restrict M, long m_first, int ld, long m_stride,
                         __global double* restrict rest, __global int* restrict pivots, __global int* restrict info,
                         __global const int* restrict items, int width, __local double* panel)
{
    __local double row_k[PANEL], largest[GPU_CREW];
    __local int place[GPU_CREW];
    const long item = items[get_group_id(0)];
    const int me = get_local_id(0);
    M += m_first + item * m_stride;
    rest += item * (long)n * PANEL;
    pivots += item * n;
    for (int first = 0; first < n; first += width) {
        const int inner = min(width, n - first), columns = n - inner;
        for (int at = me; at < inner * n; at += GPU_CREW)
            panel[at] = M[(long)(first + at / n) * ld + at % n];
        barrier(CLK_LOCAL_MEM_FENCE);

        for (int c = 0; c < inner; c++) {  // the panel's columns eliminated
            const int k = first + c;
            double most = 0.0;
            int best = k;
            for (int i = k + me; i < n; i += GPU_CREW)
                if (fabs(panel[c * n + i]) > most) {
                    most = fabs(panel[c * n + i]);
                    best = i;
                }
            largest[me] = most;
            place[me] = best;
            barrier(CLK_LOCAL_MEM_FENCE);
            for (int apart = GPU_CREW / 2; apart > 0; apart /= 2) {
                if (me < apart && largest[me + apart] > largest[me]) {
                    largest[me] = largest[me + apart];
                    place[me] = place[me + apart];
                }
                barrier(CLK_LOCAL_MEM_FENCE);
            }
            if (me == 0) {
                if (!(largest[0] > 0.0))
                    info[item] = 1;
                if (fabs(panel[c * n + k]) >= SMALL_PIVOT * largest[0])
                    place[0] = k;
                pivots[k] = place[0];
            }
            barrier(CLK_LOCAL_MEM_FENCE);
            if (me < inner) {  // rows exchanged, row k kept beside
                const double old = panel[me * n + k];
                row_k[me] = panel[me * n + place[0]];
                panel[me * n + place[0]] = old;
            }
            barrier(CLK_LOCAL_MEM_FENCE);
            for (int i = me; i < n; i += GPU_CREW) {
                const double inverse = 1.0 / row_k[c], now = panel[c * n + i];
                for (int j = 0; j < inner; j++) {
                    const double factor = row_k[j] * inverse;
                    if (j != c)
                        panel[j * n + i] = i == k ? factor : panel[j * n + i] - factor * now;
                }
                panel[c * n + i] = i == k ? inverse : -inverse * now;
            }
            barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
        }

        for (int at = me; at < inner * n; at += GPU_CREW)
            M[(long)(first + at / n) * ld + at % n] = panel[at];
        for (int j = me; j < columns; j += GPU_CREW) {  // all other columns: rows exchanged, the panel's taken out
            __global double* column = M + (long)(j < first ? j : j + inner) * ld;
            for (int k = first; k < first + inner; k++) {
                const double kept = column[k];
                column[k] = column[pivots[k]];
                column[pivots[k]] = kept;
            }
            for (int k = 0; k < inner; k++) {
                rest[(long)j * PANEL + k] = column[first + k];
                column[first + k] = 0.0;
            }
        }
        barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);

        // four columns of a row at a time: each element of the panel is read once for the four
        for (int at = me; at < (columns + 3) / 4 * n; at += GPU_CREW) {
            const int i = at % n, begin = at / n * 4;
            double sum[4] = {0.0, 0.0, 0.0, 0.0};
            for (int k = 0; k < inner; k++)
                for (int x = 0; x < 4; x++)
                    sum[x] += panel[k * n + i] * rest[(long)min(begin + x, columns - 1) * PANEL + k];
            for (int x = 0; x < 4; x++) {
                const int j = begin + x;
                if (j < columns)
                    M[(long)(j < first ? j : j + inner) * ld + i] += sum[x];
            }
        }
        barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
    }
    for (int i = me; i < n; i += GPU_CREW)  // a work-item its rows: columns exchanged back
        for (int k = n - 1; k >= 0; k--) {
            const int other = pivots[k];
            const double kept = M[(long)k * ld + i];
            M[(long)k * ld + i] = M[(long)other * ld + i];
            M[(long)other * ld + i] = kept;
        }
}
