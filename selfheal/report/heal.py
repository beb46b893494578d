"""The page of a heal (stub)."""


def heal_page(run, models):
    return "<html></html>"
