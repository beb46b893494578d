"""The page of `heal.py`: records of its suites in, docs/results/heal.md out."""


def write(root, records):
    pass
