# One mechanism for every parallel loop: the items of a stage, Fourier orders or orders and layers, done by the threads
# of a crew, (threads, seconds, stop) of vrte/basics/running.py. No item depends on another, so results do not depend on
# the number of threads.

ctypedef double* doubles
ctypedef const double* given
ctypedef int* ints
ctypedef const int* given_ints
cdef enum: LINE = 8  # doubles of a cache line

cdef extern from "core/clock.h":
    const int vrte_openmp
    double vrte_seconds() noexcept nogil

HAS_OPENMP = bool(vrte_openmp)

cdef extern from "core/constants.h":
    const double SEMI_INFINITE, DECAYING, RESONANT, NO_LIGHT, ROUNDING, THICK, COMPLEMENTED, STEEPEST_RATIO
    enum: MOST_DOUBLINGS, MOST_STEPS, SERIES, MOST_COLUMNS, MOST_ENTRIES

globals().update(
    SEMI_INFINITE=SEMI_INFINITE, NO_LIGHT=NO_LIGHT, ROUNDING=ROUNDING, THICK=THICK, COMPLEMENTED=COMPLEMENTED,
    STEEPEST_RATIO=STEEPEST_RATIO, MOST_DOUBLINGS=MOST_DOUBLINGS, MOST_STEPS=MOST_STEPS, SERIES=SERIES,
    MOST_COLUMNS=MOST_COLUMNS)


cdef struct Workspace:
    # what a thread works with: a row of scratch memory, one of scratch integers, and the flag that stops it
    doubles work
    ints pivots
    given_ints stop


cdef inline int first_layer(given_ints slab_stack, int n_layer, int item) noexcept nogil:
    """Of the scene that an item is of, among those of all scenes; `slab_stack` is NULL where there is one scene."""
    return 0 if slab_stack == NULL else slab_stack[item] * n_layer


cdef inline int layer_of(given_ints slab_stack, int n_layer, int item) noexcept nogil:
    """The layer of an item that is one layer of one order, among those of all scenes."""
    return first_layer(slab_stack, n_layer, item // n_layer) + item % n_layer


# one item of a stage's task; LAPACK's verdict, 0: fine
ctypedef int (*Stage)(const void* task, int item, Workspace desk) noexcept nogil


cdef void run_items(crew, Stage stage, const void* task, int n_item, size_t doubles, size_t integers, ints info):
    """All items of a task, each with its own `doubles` and `integers`; verdicts go to info (item,) unless NULL, seconds
    to the crew's. Begins no item once the crew's flag is set. The memory of each thread begins with a cache line, since
    BLAS on some processors adds up in another order what begins elsewhere in it."""
    cdef int item, thread, verdict, threads = crew.threads
    cdef size_t room = (doubles + LINE - 1) // LINE * LINE
    memory = np.empty(threads * room + LINE)
    memory = memory[-memory.ctypes.data % (8 * LINE) // 8 :][: threads * room]
    cdef double[:, ::1] work = memory.reshape(threads, room)
    cdef int[:, ::1] pivots = np.empty((threads, integers), np.int32)
    cdef double[::1] seconds = crew.seconds
    cdef const int[::1] stop = crew.stop
    cdef double start
    for item in prange(n_item, nogil=True, schedule="dynamic", num_threads=threads):
        thread = threadid()
        if not stop[0]:
            start = vrte_seconds()
            verdict = stage(task, item, Workspace(&work[thread, 0], &pivots[thread, 0], &stop[0]))
            if info != NULL:
                info[item] = verdict
            seconds[thread] += vrte_seconds() - start
