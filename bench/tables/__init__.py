"""Tables 1 to 3 and figure 1 of the GPU paper, measured here in its six configurations: `python -m bench.tables`.

The `paper`'s problems are measured in every `Configuration`, in `processes` of two SIMD settings, and set beside what
it prints on a `page`.
"""
