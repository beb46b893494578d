"""What several tests of benchmarks need."""

from dataclasses import replace

import pytest

from benchmarks.hidden import drafts


@pytest.fixture
def shorten_drives(monkeypatch):
    """Has a kind's cases of drives be of one episode each, so many seconds long."""

    def shorten(kind, seconds):
        draft = drafts.KINDS[kind]

        def draw(rng, seed):
            whole = draft(rng, seed)
            log = replace(whole.log, seconds=seconds, episodes=1, held=1)
            return replace(whole, log=log)

        monkeypatch.setitem(drafts.KINDS, kind, draw)

    return shorten
