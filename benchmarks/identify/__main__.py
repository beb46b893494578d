"""Runs `benchmarks.identify.runs`, whose functions worker processes import by name."""

from benchmarks.identify.runs import main

if __name__ == "__main__":
    main()
