# One mechanism for every parallel loop: the items of a stage, Fourier orders or orders and layers, done by the threads
# of a crew, (threads, seconds, stop) of vrte/basics/running.py. No item depends on another, so results do not depend on
# the number of threads. What a stage takes is declared in stages.toml: `Arrays` holds all of it, sizes first.

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
    const double WEAKEST_RATE, NEAR, OF_HALF
    enum: MOST_DOUBLINGS, MOST_STEPS, FEWEST_TO_HALVE, SERIES, MOST_COLUMNS, MOST_ENTRIES

globals().update(
    SEMI_INFINITE=SEMI_INFINITE, NO_LIGHT=NO_LIGHT, ROUNDING=ROUNDING, THICK=THICK, COMPLEMENTED=COMPLEMENTED,
    STEEPEST_RATIO=STEEPEST_RATIO, MOST_DOUBLINGS=MOST_DOUBLINGS, MOST_STEPS=MOST_STEPS,
    FEWEST_TO_HALVE=FEWEST_TO_HALVE, SERIES=SERIES, MOST_COLUMNS=MOST_COLUMNS)

cdef extern from "numpy/arrayobject.h":
    ctypedef struct PyArrayObject:
        pass
    enum: NPY_DOUBLE, NPY_INT, NPY_CDOUBLE
    int _import_array() except -1
    bint PyArray_Check(object)
    int PyArray_NDIM(PyArrayObject*)
    int PyArray_TYPE(PyArrayObject*)
    bint PyArray_EquivTypenums(int, int)
    bint PyArray_ISCARRAY(PyArrayObject*)
    bint PyArray_ISCARRAY_RO(PyArrayObject*)
    bint PyArray_ISBEHAVED_RO(PyArrayObject*)
    void* PyArray_DATA(PyArrayObject*)
    Py_ssize_t* PyArray_DIMS(PyArrayObject*)
    const Py_ssize_t* PyArray_STRIDES(PyArrayObject*)
    object PyArray_EMPTY(int, Py_ssize_t*, int, int)
    object PyArray_ZEROS(int, Py_ssize_t*, int, int)

_import_array()

include "arrays.pxi"

cdef extern from "arrays.h":
    enum: VRTE_SIZES, VRTE_EQUATIONS
    ctypedef struct vrte_argument:
        # an array, or a number with rank 0; dims: sizes by index, or minus a number
        const char* name
        int form, rank, written, open, size, has_preset
        double preset
        int dims[6]
        size_t place
    ctypedef struct vrte_stage:
        const char* name
        int first, count
        const char* words
    ctypedef struct vrte_equation:
        int whole, is_product, count
        int parts[3]
    const char* vrte_size_names[]
    const int vrte_otherwise[]      # sizes where nothing tells them, -1: unknown
    const vrte_argument vrte_arguments[]
    const vrte_stage vrte_stages[]
    const vrte_equation vrte_equations[]

cdef enum Form: REAL, WHOLE, COMPLEX, STRIDED, NUMBER, INTEGER, FLAG     # as FORMS of declare.py


cdef struct Workspace:
    # what a thread works with: a row of scratch memory, one of scratch integers, and the flag that stops it
    doubles work
    ints pivots
    given_ints stop


cdef struct Job:
    # items of a stage, doubles and integers of scratch memory that a thread needs
    size_t items, doubles, integers


cdef inline int first_layer(given_ints slab_stack, int n_layer, int item) noexcept nogil:
    """Of the scene that an item is of, among those of all scenes; `slab_stack` is NULL where there is one scene."""
    return 0 if slab_stack == NULL else slab_stack[item] * n_layer


cdef inline int layer_of(given_ints slab_stack, int n_layer, int item) noexcept nogil:
    """The layer of an item that is one layer of one order, among those of all scenes."""
    return first_layer(slab_stack, n_layer, item // n_layer) + item % n_layer


# one item of a stage's task; LAPACK's verdict, 0: fine
ctypedef int (*Kernel)(const Arrays* t, int item, Workspace desk) noexcept nogil
ctypedef Job (*Plan)(Arrays* t) noexcept nogil


cdef struct Calls:
    # calls of one stage, and the first item of each
    Kernel kernel
    int count
    Arrays* of
    ints first


cdef void run_items(crew, const Calls* calls, Job job):
    """All items of some calls, each with its own `doubles` and `integers`; verdicts go to info, seconds to the crew's.
    Begins no item once the crew's flag is set. The memory of each thread begins with a cache line, since BLAS on some
    processors adds up in another order what begins elsewhere in it."""
    cdef int item, thread, n_item = <int>job.items, threads = crew.threads
    cdef size_t room = (job.doubles + LINE - 1) // LINE * LINE, integers = job.integers
    memory, numbers = np.empty(threads * room + LINE), np.empty(threads * integers + 1, np.int32)
    cdef double* seconds = <double*>data_of(crew.seconds, "the crew", "seconds", REAL, True)
    cdef const int* stop = <const int*>data_of(crew.stop, "the crew", "stop", WHOLE, False)
    cdef double* work = <double*>data_of(memory, "", "memory", REAL, True)
    cdef int* pivots = <int*>data_of(numbers, "", "memory", WHOLE, True)
    cdef double start
    work += (-(<size_t>work // sizeof(double))) % LINE
    for item in prange(n_item, nogil=True, schedule="dynamic", num_threads=threads):
        thread = threadid()
        if not stop[0]:
            start = vrte_seconds()
            run_item(calls, item, Workspace(work + thread * room, pivots + thread * integers, stop))
            seconds[thread] += vrte_seconds() - start


cdef void run_item(const Calls* calls, int item, Workspace desk) noexcept nogil:
    cdef int k = calls.count - 1, verdict
    while calls.first[k] > item:
        k -= 1
    verdict = calls.kernel(&calls.of[k], item - calls.first[k], desk)
    if calls.of[k].info != NULL:
        calls.of[k].info[item - calls.first[k]] = verdict


cdef void* data_of(object values, object owner, str name, int form, bint written) except? NULL:
    """Where an array of an owner has its numbers, of its form, one behind the other unless it is STRIDED."""
    cdef PyArrayObject* array = <PyArrayObject*>values
    if not PyArray_Check(values):
        raise TypeError(f"{owner}: {name} must be an array, not {type(values).__name__}")
    if not PyArray_EquivTypenums(PyArray_TYPE(array), type_of(form)):
        raise ValueError(f"{owner}: {name} must be of {TYPES[form]}, not {values.dtype}")
    if form == STRIDED:
        if not PyArray_ISBEHAVED_RO(array):
            raise ValueError(f"{owner}: {name} must be aligned")
    elif not (PyArray_ISCARRAY(array) if written else PyArray_ISCARRAY_RO(array)):
        raise ValueError(f"{owner}: {name} must be contiguous" + (" and writeable" if written else ""))
    return PyArray_DATA(array)


TYPES = "float64", "int32", "complex128", "float64"     # of the forms


cdef inline int type_of(int form) noexcept:
    return NPY_INT if form == WHOLE else NPY_CDOUBLE if form == COMPLEX else NPY_DOUBLE


cdef class Stage:
    """A stage of a solve: called with a crew and its arrays by name, which are checked. What it writes and nobody gives
    is allocated and returned, an array or several by name."""
    cdef const vrte_stage* said
    cdef const vrte_argument* taken
    cdef Kernel kernel
    cdef Plan plan
    cdef bint alone
    cdef tuple names, names_read

    @property
    def reads(self):
        """Names of what it reads."""
        return self.names_read

    @property
    def __name__(self):
        return self.said.name.decode()

    def __str__(self):
        return self.__name__

    @property
    def __doc__(self):
        return self.said.words.decode()

    @property
    def __signature__(self):
        from inspect import Parameter, Signature
        kind = Parameter.POSITIONAL_OR_KEYWORD if self.alone else Parameter.KEYWORD_ONLY
        found = [] if self.alone else [Parameter("crew", Parameter.POSITIONAL_ONLY)]
        for k in range(self.said.count):
            default = None if self.taken[k].open else Parameter.empty
            found.append(Parameter(self.names[k], kind, default=default))
        return Signature(found)

    def __call__(self, *places, **given):
        if self.alone:
            given.update(zip(self.names, places))
            places = (ALONE,)
        if len(places) != 1:
            raise TypeError(f"{self.__name__} takes a crew, and its arrays by name")
        return call_together(self, places[0], [given])[0]

    def allocate(self, given):
        """What the stage writes and is not given, allocated, by name."""
        cdef Arrays t
        return self.read(given, {}, &t)

    cdef dict read(self, dict given, dict shared, Arrays* t):
        """Fills t of what is given, or else shared with other calls, and checks shapes; what is allocated."""
        cdef int k, d, size, used = 0
        cdef int* sizes = <int*>t
        cdef char* place
        cdef void* memory
        cdef const vrte_argument* each
        cdef dict found = {}
        cdef Py_ssize_t* shape
        cdef Py_ssize_t wanted[6]
        memset(t, 0, sizeof(Arrays))
        for k in range(VRTE_SIZES):
            sizes[k] = -1
        for k in range(self.said.count):
            each, place = self.taken + k, <char*>t + self.taken[k].place
            values = given.get(self.names[k])
            if values is None and not each.written and self.names[k] not in given:
                values = shared.get(self.names[k])
                used -= values is not None
            if values is None:
                used += self.names[k] in given
                if not each.open:
                    raise TypeError(f"{self.__name__} needs {self.names[k]}")
                if each.written:
                    found[self.names[k]] = k
                    continue
                if each.form == NUMBER:
                    (<double*>place)[0] = each.preset
                elif each.rank == 0:
                    (<int*>place)[0] = <int>each.preset
                continue
            used += 1
            if each.form == NUMBER:
                (<double*>place)[0] = values
            elif each.form == FLAG:
                (<int*>place)[0] = bool(values)
            elif each.form == INTEGER:
                (<int*>place)[0] = values
            else:
                memory = data_of(values, self, self.names[k], each.form, each.written)
                memcpy(place, &memory, sizeof(void*))
                shape = PyArray_DIMS(<PyArrayObject*>values)
                if each.form == STRIDED:
                    memory = <void*>PyArray_STRIDES(<PyArrayObject*>values)
                    memcpy(place + sizeof(void*), &memory, sizeof(void*))
                if PyArray_NDIM(<PyArrayObject*>values) != each.rank:
                    self.complain(each, sizes, values)
                for d in range(each.rank):
                    size = each.dims[d]
                    if size >= 0 and sizes[size] < 0:
                        sizes[size] = <int>shape[d]
                    elif shape[d] != (sizes[size] if size >= 0 else -size):
                        self.complain(each, sizes, values)
        if used != len(given):
            raise TypeError(f"{self.__name__} does not take {', '.join(given.keys() - set(self.names))}")
        if find_sizes(sizes) >= 0:
            self.complain_of_sizes(sizes)
        for name, index in found.items():
            each = self.taken + <int>index
            for d in range(each.rank):
                wanted[d] = sizes[each.dims[d]] if each.dims[d] >= 0 else -each.dims[d]
                if wanted[d] < 0:
                    raise TypeError(f"{self.__name__} needs {name}: nothing tells how large it is")
            if each.has_preset:
                values = PyArray_ZEROS(each.rank, wanted, type_of(each.form), 0)
            else:
                values = PyArray_EMPTY(each.rank, wanted, type_of(each.form), 0)
            memory = PyArray_DATA(<PyArrayObject*>values)
            memcpy(<char*>t + each.place, &memory, sizeof(void*))
            found[name] = values
        for k in range(VRTE_SIZES):
            sizes[k] = max(sizes[k], 0)
        return found

    cdef complain(self, const vrte_argument* each, int* sizes, values):
        """Raises ValueError for an array whose shape does not fit the others'."""
        wanted = []
        for d in range(each.rank):
            name = vrte_size_names[each.dims[d]].decode() if each.dims[d] >= 0 else ""
            size = sizes[each.dims[d]] if each.dims[d] >= 0 else -each.dims[d]
            wanted.append(f"{name} {size}".strip() if size >= 0 else name)
        raise ValueError(f"{self.__name__}: {each.name.decode()} must have the shape ({', '.join(wanted)}), "
                         f"not {values.shape}")

    cdef complain_of_sizes(self, int* sizes):
        """Raises ValueError for sizes that do not make each other."""
        cdef const vrte_equation* e = vrte_equations + solve_equations(sizes)
        sign = " * " if e.is_product else " + "
        parts = [e.parts[k] for k in range(e.count)]
        names = [vrte_size_names[part].decode() if part >= 0 else str(-part) for part in parts]
        counts = sign.join([str(sizes[part] if part >= 0 else -part) for part in parts])
        raise ValueError(f"{self.__name__}: {vrte_size_names[e.whole].decode()} must be {sign.join(names)} = {counts}, "
                         f"not {sizes[e.whole]}")


cdef int find_sizes(int* sizes) noexcept nogil:
    """Sizes that follow from others, or that nothing tells; the first equation that does not hold, -1 for none."""
    cdef int k, failed = solve_equations(sizes)
    if failed < 0:
        for k in range(VRTE_SIZES):
            if sizes[k] < 0:
                sizes[k] = vrte_otherwise[k]
        failed = solve_equations(sizes)
    return failed


cdef int solve_equations(int* sizes) noexcept nogil:
    """Sizes that follow from others; the first equation that does not hold, -1 for none."""
    cdef int turn, k, i, part, unknown, open_, known
    cdef const vrte_equation* e
    for turn in range(3):
        for k in range(VRTE_EQUATIONS):
            e = &vrte_equations[k]
            known, open_, unknown = 1 if e.is_product else 0, 0, -1
            for i in range(e.count):
                part = sizes[e.parts[i]] if e.parts[i] >= 0 else -e.parts[i]
                if part < 0:
                    open_, unknown = open_ + 1, e.parts[i]
                else:
                    known = known * part if e.is_product else known + part
            if open_ == 0:
                if sizes[e.whole] < 0:
                    sizes[e.whole] = known
                elif sizes[e.whole] != known:
                    return k
            elif open_ == 1 and sizes[e.whole] >= 0:
                if not e.is_product:
                    if sizes[e.whole] < known:
                        return k
                    sizes[unknown] = sizes[e.whole] - known
                elif known > 0:
                    sizes[unknown] = sizes[e.whole] // known
                    if sizes[unknown] * known != sizes[e.whole]:
                        return k
    return -1


def call_together(stage, crew, calls, shared={}):
    """What a stage, or one by name, returns for several calls, each its arrays by name: one crew shares all items. What
    a call has not is taken from those that are shared, among which there may be others."""
    cdef Stage one = stage if isinstance(stage, Stage) else globals()[stage]
    cdef Calls all_of
    cdef Job job, most = Job(0, 0, 0)
    cdef int k
    memory = np.empty(len(calls) * (sizeof(Arrays) + sizeof(int)) + sizeof(Arrays), np.uint8)
    all_of.kernel, all_of.count, all_of.of = one.kernel, len(calls), <Arrays*>PyArray_DATA(<PyArrayObject*>memory)
    all_of.first = <int*>(all_of.of + all_of.count)
    found = []
    for k, given in enumerate(calls):
        found.append(one.read(given, shared, &all_of.of[k]))
        job = one.plan(&all_of.of[k])
        if all_of.of[k].wrong != NULL:
            raise ValueError(f"{one}: {all_of.of[k].wrong.decode()}")
        all_of.first[k] = <int>most.items
        most.items += job.items
        most.doubles, most.integers = max(most.doubles, job.doubles), max(most.integers, job.integers)
    run_items(crew, &all_of, most)
    return [result_of(each) for each in found]


def result_of(found):
    """What a stage returns of the arrays that it allocated, by name: one array alone, None for none."""
    return None if not found else found if len(found) > 1 else next(iter(found.values()))


def count_scratch(stage, **sizes):
    """Doubles of scratch memory that a thread needs for a stage, by name, of sizes by name."""
    cdef Arrays t
    cdef Stage one = globals()[stage]
    cdef int* counts = <int*>&t
    cdef int k
    memset(&t, 0, sizeof(Arrays))
    for k in range(VRTE_SIZES):
        counts[k] = sizes.pop(vrte_size_names[k].decode(), -1)
    if sizes:
        raise TypeError(f"there are no sizes {', '.join(sizes)}")
    find_sizes(counts)
    for k in range(VRTE_SIZES):
        counts[k] = max(counts[k], 0)
    return one.plan(&t).doubles


class Alone:
    """The crew of a stage that needs none."""
    threads, seconds, stop = 1, np.zeros(1), np.zeros(1, np.int32)

ALONE = Alone


cdef Stage make_stage(int index, Kernel kernel, Plan plan, bint with_crew):
    """The stage in a row of the declarations."""
    cdef Stage stage = Stage.__new__(Stage)
    stage.said, stage.kernel, stage.plan, stage.alone = &vrte_stages[index], kernel, plan, not with_crew
    stage.taken = vrte_arguments + stage.said.first
    stage.names = tuple([sys.intern(stage.taken[k].name.decode()) for k in range(stage.said.count)])
    stage.names_read = tuple([stage.names[k] for k in range(stage.said.count) if not stage.taken[k].written])
    return stage
