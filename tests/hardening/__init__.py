"""Damaged files, in the process of the tests: a part of benchmarks.hardening."""
