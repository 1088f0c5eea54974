// Steps of a list for one item, one behind the other: what else is a launch each is one launch of a crew an item, which shares
// each step, so that nothing waits for the host. See steps.py, which writes the lists.

#define STEP_SIZE 40        // numbers of a step: its kind, where its items are told, whole numbers, three operands
#define OF_A 16
#define OF_B 24
#define OF_C 32

// The kinds, in the order of KINDS in steps.py.
#define PRODUCT_STEP 0
#define STRAIGHT_STEP 1
#define COMBINE_STEP 2
#define INVERT_STEP 3
#define PREPARE_STEP 4
#define LARGEST_STEP 5
#define BLEND_STEP 6
#define MIRROR_STEP 7
#define GO_STEP 8
#define LEAD_STEP 9
#define DIVIDE_STEP 10

// Of a step's operand: which memory, where item 0 begins, distances of columns and of items; the same for OO and II.
typedef struct {
    __global real* M;
    __global real* OO;
    __global real* II;
    int ld;
} Operand;

Operand find_operand(__global const long* told, long item, __global real* first, __global real* second)
{
    __global real* memory = told[0] ? second : first;
    const Operand found = {memory + told[1] + item * told[3], memory + told[4] + item * told[5],
                           memory + told[6] + item * told[7], told[2]};
    return found;
}

#define CREW_COLUMNS(j, columns) for (int j = get_local_id(1); j < (columns); j += CREW_ROWS)
#define STRIPS_AT_ONCE 10

// C = alpha A B + beta C, by strips or by tiles.
void multiply_by_crew(int rows, int columns, int inner, real alpha, real beta, __global const real* A, int a_ld,
                      __global const real* B, int b_column, __global real* C, int c_ld, __local real* shelf)
{
    const int b_row = 1;
#if LANES > 1
    __local real(*a_tile)[GPU_TILE] = (__local real(*)[GPU_TILE])shelf;
    __local real(*b_tile)[GPU_TILE + 1] = (__local real(*)[GPU_TILE + 1])(shelf + GPU_DEPTH * GPU_TILE);
    const int here = MATE, row = here % GPU_GROUP, column = here / GPU_GROUP;
    for (int left = 0; left < columns; left += GPU_TILE)
        for (int top = 0; top < rows; top += GPU_TILE) {
            GPU_SUM_TERMS
            GPU_EACH_ELEMENT(GPU_STORE)
        }
#else
    for (int first = 0; first < rows / 8; first += STRIPS_AT_ONCE)
        product_of_strips(first, min(rows / 8, first + STRIPS_AT_ONCE), columns, inner, alpha, beta, A, a_ld, B, b_row,
                          b_column, C, c_ld);
#endif
}

// The largest that any of a crew has, to all of them; shelf: room for one of each.
real largest_of_crew(real mine, __local real* shelf)
{
    if (LANES == 1)
        return mine;
    shelf[MATE] = mine;
    for (int apart = CREW_ROWS * LANES / 2; apart > 0; apart /= 2) {
        TOGETHER
        if (MATE < apart)
            shelf[MATE] = larger(shelf[MATE], shelf[MATE + apart]);
    }
    TOGETHER
    return shelf[0];
}

// One work-group an item: which steps are its own, from the first to the one behind the last, and which item that is, three
// numbers each in `programs`. told: STEP_SIZE numbers a step; shares: alpha, beta and gamma of each; chosen: whether an item
// takes part; numbers: what a step has for each item, direction or beam; width: columns of a panel of an inverse.
__attribute__((reqd_work_group_size(LANES, CREW_ROWS, 1)))
__kernel void carry_out_steps(INTS programs, __global const long* restrict all_told, IN shares, INTS chosen, IN numbers,
                              __global real* first, __global real* second, int width, __local real* shelf)
{
    const int group = get_group_id(0);
    const long item = programs[3 * group + 2];
    for (int step = programs[3 * group]; step < programs[3 * group + 1]; step++) {
        __global const long* told = all_told + (long)step * STEP_SIZE;
        if (!chosen[told[1] + item])
            continue;
        const int kind = told[0], rows = told[2], columns = told[3], inner = told[4];
        const Operand a = find_operand(told + OF_A, item, first, second), b = find_operand(told + OF_B, item, first, second),
                      c = find_operand(told + OF_C, item, first, second);
        const Sizes s = {told[5], told[6], told[7], told[8], c.ld};
        const Extended A = {a.M, a.OO, a.II}, B = {b.M, b.OO, b.II}, C = {c.M, c.OO, c.II};
        const int way = told[9];
        __global const real* h = told[10] < 0 ? 0 : numbers + told[10] + item;
        __global const real* rate_OO = numbers + told[11];
        __global const real* rate_II = numbers + told[12];
        const real alpha = shares[3 * step], beta = shares[3 * step + 1], gamma = shares[3 * step + 2];
        if (kind == PRODUCT_STEP)
            multiply_by_crew(rows, columns, inner, alpha, beta, a.M, a.ld, b.M, b.ld, c.M, c.ld, shelf);
        else if (kind == STRAIGHT_STEP) {
            CREW_COLUMNS(j, s.n + s.r)
                add_straight_beam(j, s, alpha, A, B, C);
            TOGETHER
            CREW_COLUMNS(j, s.n + s.r)
                add_straight_rows(j, s, alpha, A, B, C, gamma, way, h, rate_OO, rate_II);
        } else if (kind == COMBINE_STEP) {
            CREW_COLUMNS(j, s.n + s.r)
                combine_column(j, s, h ? alpha * *h : alpha, A, beta, B, gamma, C);
        } else if (kind == INVERT_STEP) {
            __global int* pivots = (__global int*)b.II + item * rows;
            __global int* info = (__global int*)b.OO + item;
#if LANES > 1
            __local real* row_k = shelf;
            __local real* largest = row_k + PANEL;
            __local int* place = (__local int*)(largest + GPU_CREW);
            invert_by_crew(MATE, rows, c.M, c.ld, b.M, pivots, info, width, largest + 2 * GPU_CREW, row_k, largest, place);
#else
            invert_alone(rows, c.M, c.ld, b.M, pivots, info);
#endif
        } else if (kind == PREPARE_STEP) {
            CREW_COLUMNS(j, s.n + s.r)
                prepare_column(j, s, A, C);
        } else if (kind == LARGEST_STEP) {
            real found = 0.0;
            CREW_SPREAD(j, 0, columns)
                found = larger(found, find_size_of_column(rows, way, a.M + (long)j * a.ld));
            found = largest_of_crew(found, shelf);
            if (MATE == 0)
                *c.M = found;
        } else if (kind == BLEND_STEP) {
            CREW_COLUMNS(j, columns)
                blend_column(j, rows, alpha, a.M + (long)j * a.ld, beta, b.M + (long)j * b.ld, gamma, c.M + (long)j * c.ld);
        } else if (kind == MIRROR_STEP) {
            CREW_SPREAD(i, 0, s.n)
                mirror_element(i, s, rows, columns, inner, C.M);
        } else if (kind == GO_STEP) {
            CREW_SPREAD(i, 0, s.o)
                C.OO[i] = straight_light(way, h ? *h * rate_OO[i] : 0.0);
            CREW_SPREAD(i, 0, s.r)
                C.II[i] = straight_light(way, h ? *h * rate_II[i] : 0.0);
        } else if (kind == LEAD_STEP) {
            CREW_COLUMNS(j, s.n + s.r)
                lead_column_straight(j, s, A.M + (long)j * s.ld, B.OO, B.II, C.M + (long)j * s.ld);
        } else if (kind == DIVIDE_STEP) {
            CREW_COLUMNS(j, s.r)
                divide_column_by_rates(s, rate_OO, rate_II[j], C.M + (long)(s.n + j) * s.ld + s.p);
        }
        TOGETHER
    }
}
