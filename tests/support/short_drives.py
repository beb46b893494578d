"""Cases of drives that are quickly made."""

from dataclasses import replace

from benchmarks.hidden import drafts


def shorten_drives(monkeypatch, kind, seconds):
    """Have a kind's cases be of one episode each, as long as is asked [s]."""
    draft = drafts.KINDS[kind]

    def shorten(rng, seed):
        whole = draft(rng, seed)
        log = replace(whole.log, seconds=seconds, episodes=1, held=1)
        return replace(whole, log=log)

    monkeypatch.setitem(drafts.KINDS, kind, shorten)
