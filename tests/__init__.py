"""Tests of selfheal; OpenBLAS has one thread in each worker, as on the command line."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when NumPy is imported
