"""Gaits: a self-model in, joint commands that carry it along out."""
