"""The paper's equations in plain dense NumPy, float64, for tests only: what the kernels are held against.

Written from [BW98] and from what the docs say differs from it, loop by loop, without the package's structure. `jet` gives
every condition its derivatives, so that none is written down here a second time.

`geometry` says where cloth is against solids and itself, from positions alone.
"""
