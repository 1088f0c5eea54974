"""How the cost grows: figures 2 to 9 of the GPU paper, measured here, with fitted exponents beside its claims.

`python -m bench.cost` measures the `axes` and writes a `page` with its figures.
"""
