"""Search for sets of effects in the linear model: takes directions, gives terms.

Forward selection with backward elimination after each step (Efroymson 1960), by the
posterior of sets: likelihood, prior of values, and log-odds of each effect.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..effects.base import Effect, Term
from ..effects.terms import find_other_forms, is_distinct
from .cross_validation import compute_gains, is_worth_more
from .errors import Direction
from .fit import LinearFit, add_terms, descend, invert, refine, remove_terms
from .likelihood import estimate_independence
from .ranking import (
    can_stand_beside,
    label_move,
    list_moves,
    name_move,
    propose_directions,
    rank,
)

TRIED = 5  # moves that are fitted beyond the best one
NEAR_SHARE = 0.5  # of the best gain, beyond its penalty, by which another is predicted
MOST_NEAR = 2  # moves beside the best that simulations may prefer
FINALISTS = 30  # candidates that are tried in all rows, and moves fitted in vain
MOST_EFFECTS = 60
RESAMPLES = 200

Progress = Callable[[str, int], None]


class Search:
    """A search for the set of effects that equation errors ask for.

    Attributes:
        fit: of what has a name so far.
        path: fits that were reached, each with a move more; the last is the answer.
        near: fits with other moves that were worth nearly as much as the last one.
        first_ranking: candidates beside the model as given, each with the share of the
            mean square error that it leaves.
    """

    def __init__(
        self,
        start: LinearFit,
        candidates: Sequence[Term],
        progress: Progress = lambda what, named: None,
    ) -> None:
        """What is searched.

        Args:
            start: fit to begin with, from where values are fitted first.
            progress: called with what is tried and how many effects have a name.
        """
        self.candidates, self.say = candidates, progress
        self.fit = start if start.model.is_rough else refine(start)
        self.path: list[LinearFit] = []
        self.near: list[LinearFit] = []
        self._excluded: set[str] = set()
        self._directions: list[Direction] = []
        # gain and price [nats], share of independent errors, fit of moves worth it
        self._earned: list[tuple[float, float, float, LinearFit]] = []
        self.first_ranking: tuple[tuple[Term, float], ...] = ()

    @property
    def reached(self) -> LinearFit:
        """The best fit so far, in the middle of a move too."""
        return self._sort_earned()[0][1] if self._earned else self.fit

    def _sort_earned(self) -> list[tuple[float, LinearFit]]:
        """Gain less price [nats], and fit, of moves worth it, the best first."""
        least = min(share for _, _, share, _ in self._earned)  # alike for all
        nets = [(least * gain - price, fit) for gain, price, _, fit in self._earned]
        return sorted(nets, key=lambda each: -each[0])

    def run(self) -> LinearFit:
        """The set of effects after all moves that are worth it, fitted."""
        while self.make_move():
            pass
        self.fit = refine(self.fit)
        self.finish()
        return self.fit

    def make_move(self) -> bool:
        """Make the move that is worth most, if one is; whether it was made."""
        while len(self.fit.named) < MOST_EFFECTS:
            is_fresh = not self._directions
            if is_fresh:
                self._directions = self._propose()
            before = {t.key for t in self.fit.named}
            if new := self._select(self._directions):
                (best, _), *others = self._sort_earned()
                near = [fit for net, fit in others if net > NEAR_SHARE * best]
                self.fit, self.near, self._earned = new, near[:MOST_NEAR], []
                for term in new.named:
                    if term.key not in before:
                        self._exchange(term, [term.effect])
                self.fit = self._eliminate(self.fit)
                self.path.append(self.fit)
                gone = before - {t.key for t in self.fit.named}
                self._excluded |= {str(key) for key in gone}
                return True
            if is_fresh:
                break
            self.fit = refine(self.fit)  # what was found may have made others visible
            self._excluded, self._directions = set(), []
        return False

    def finish(self) -> None:
        """Remove what is needless, and exchange what has a likelier form."""
        self.fit = self._eliminate(self.fit)
        for term in self.fit.named:
            self._exchange(term, [t.effect for t in self.candidates])
        self.fit = self._eliminate(self.fit)
        self.path.append(self.fit)

    def _exchange(self, term: Term, effects: Sequence[Effect]) -> None:
        """Put another form of a term, of these effects, in its place if likelier."""
        fit, (share, rows) = self.fit, self._independence(self.fit)
        rest = [t for t in fit.named if t is not term]
        others = [
            t
            for t in find_other_forms(term, self.candidates)
            if is_distinct(t, rest) and t.effect in effects
        ]
        if not others:
            return
        less = remove_terms(fit, [fit.terms.index(term)])
        best = share * fit.cost + self._price(fit, fit.terms.index(term), rows)
        moves = [(d,) for d in _differentiate(less, others)]
        for _, move, coordinates in rank(less, moves)[:TRIED]:
            new = add_terms(less, move, coordinates)
            cost = share * new.cost + self._price(new, len(new.terms) - 1, rows)
            is_small = move[0].term.is_negligible(new.named_values[-1])
            if cost < best and not is_small and is_worth_more(fit, new):
                self.fit, best = new, cost

    def find_rivals(
        self, fit: LinearFit, less: LinearFit, term: Term
    ) -> tuple[Term, ...]:
        """Candidates that explain as much in a term's place, the likeliest first.

        Those whose gain is less by no more than what a parameter more would have to
        gain; they begin at the values that they have there.
        """
        share, rows = self._independence(fit)
        least = less.cost - fit.cost - 0.5 * np.log(rows) / share
        moves = [(d,) for d in self._directions if is_distinct(d.term, less.named)]
        ranked = rank(less, [m for m in moves if m[0].term.key != term.key])
        found = []
        for gain, move, coordinates in ranked[: 2 * TRIED]:
            if gain < least:
                break
            new = add_terms(less, move, coordinates)
            gained, at = less.cost - new.cost, tuple(new.named_values[-1].tolist())
            if gained >= least:
                found.append((gained, replace(new.named[-1], initial_values=(at,))))
        found.sort(key=lambda each: -each[0])
        return tuple(t for _, t in found)

    def weigh(
        self, fit: LinearFit, less: LinearFit, term: Term, rng: np.random.Generator
    ) -> tuple[float, float, float]:
        """What speaks for a named term, beside all others.

        Returns:
            Gain of the likelihood [nats] per independent error. The p-value of its
            likelihood-ratio test (Wilks 1938), corrected for all candidates
            (Bonferroni). Share of resamples of the blocks that it helps to predict.
        """
        from scipy.stats import chi2

        share, rows = self._independence(fit)
        nats = max(share * (less.cost - fit.cost), 0.0)
        p_value = len(self.candidates) * chi2.sf(2 * nats, max(len(term.parameters), 1))
        gains = compute_gains(less, fit)
        draws = rng.integers(len(gains), size=(RESAMPLES, len(gains)))
        stability = (gains[draws].sum(axis=1) > 0).mean()
        return nats / rows, float(min(1.0, p_value)), float(stability)

    def _penalty(self, term: Term, rows: float, count: int | None = None) -> float:
        """[nats] by which a term has to lower the cost.

        One of so many candidates (Bonferroni), a log n / 2 for each parameter (Schwarz
        1978), and what it makes it less likely that it is rare, or not usual.

        Args:
            term: to be added, or to stay.
            rows: how many independent errors there are.
            count: of its parameters that change anything; None: all.
        """
        count = len(term.parameters) if count is None else count
        return float(
            np.log(len(self.candidates)) + 0.5 * count * np.log(rows) - term.log_odds
        )

    def _price(self, fit: LinearFit, i: int, rows: float) -> float:
        """Penalty [nats] of the i-th term of a fit; a wind along a hinge is none."""
        return self._penalty(fit.terms[i], rows, fit.count_felt(i))

    def _independence(self, fit: LinearFit) -> tuple[float, float]:
        """Share of independent errors of a fit, and their number.

        What a fit misses is alike from row to row. So whether a move is worth it, the
        errors with it tell, for without it they are no noise.
        """
        share = estimate_independence(fit.whitening)
        return share, share * fit.whitening.errors.size

    def _propose(self) -> list[Direction]:
        """Directions of the candidates that may be worth it, seen in some rows.

        Of a gain g in a part the noise has one standard error: what two more of them
        would not make enough is not looked at in all rows.
        """
        fit, size = self.fit, self.fit.whitening.errors.size
        share = fit.model.screening_share
        open_terms = [t for t in self.candidates if can_stand_beside(t, fit.named)]
        if share > 1.5:
            part = fit.thin(share)
            hopeful = set()
            for gain, move, _ in rank(
                part, [(d,) for d in _differentiate(part, open_terms)]
            )[:FINALISTS]:
                most = share * (np.sqrt(max(2 * gain, 0.0)) + 2) ** 2 / 2
                if most > self._penalty(move[0].term, size):
                    hopeful.add(move[0].term.key)
            open_terms = [t for t in open_terms if t.key in hopeful or t.is_usual]
        return _differentiate(fit, open_terms)

    def _select(self, directions: Sequence[Direction]) -> LinearFit | None:
        """The fit with the move that lowers the cost most, beyond its penalty."""
        fit, size = self.fit, self.fit.whitening.errors.size
        moves = list_moves(fit, directions)
        # none that was tried in vain since the directions were computed
        ranked = rank(fit, [m for m in moves if name_move(m) not in self._excluded])
        if not self.first_ranking:
            singles = ((m[0].term, gain) for gain, m, _ in ranked if len(m) == 1)
            self.first_ranking = tuple((t, np.exp(-2 * g / size)) for t, g in singles)
        most = {
            id(m): gain - sum(self._penalty(d.term, size) for d in m)
            for gain, m, _ in ranked
        }
        ranked.sort(key=lambda each: -most[id(each[1])])
        earned = self._earned = []
        best, worse, failed = 0.0, 0, 0
        is_rough = fit.model.is_rough
        most_failed = TRIED if is_rough else FINALISTS
        for _, move, coordinates in ranked:
            is_far = most[id(move)] < NEAR_SHARE * best
            if is_far or worse == TRIED or failed == most_failed:
                break
            self.say(f"trying {label_move(move)}", len(fit.named))
            tried = self._eliminate(add_terms(fit, move, coordinates))
            gain, price, share = self._compare(tried)
            # a Jacobian held too long misleads, or leads nowhere
            if not is_rough and (share * gain > price or failed < TRIED):
                tried = self._eliminate(descend(tried.linearized()))
                gain, price, share = self._compare(tried)
            is_small = all(
                t in fit.named or t.is_negligible(v)
                for t, v in zip(tried.named, tried.named_values, strict=True)
            )
            net = share * gain - price
            if is_small or net < 0 or compute_gains(fit, tried).sum() < 0:
                self._excluded.add(name_move(move))
                failed += 1
                continue
            earned.append((gain, price, share, tried))
            worse += net <= best
            best = max(best, net)
        return self.reached if earned else None

    def _compare(self, tried: LinearFit) -> tuple[float, float, float]:
        """What a fit gains [nats], by how much it has to, and its share of rows."""
        share, rows = self._independence(tried)
        price, before = (
            sum(self._price(f, i, rows) for i in range(f.stated, len(f.terms)))
            for f in (tried, self.fit)
        )
        return self.fit.cost - tried.cost, price - before, share

    def _eliminate(self, fit: LinearFit) -> LinearFit:
        """The fit without terms whose removal costs less than their penalty."""
        needed: set[tuple] = set()
        while True:
            removed, least = self._plan_removal(fit, needed)
            if not removed:
                return fit
            while removed:
                less = remove_terms(fit, removed)
                lost = less.cost - fit.cost
                if lost <= least[len(removed) - 1]:
                    fit = less
                    break
                if len(removed) == 1:
                    needed.add(fit.terms[removed[0]].key)
                removed = removed[: len(removed) // 2]

    def _plan_removal(
        self, fit: LinearFit, needed: set[tuple]
    ) -> tuple[list[int], list[float]]:
        """Numbers of terms to remove, and what the first ones of them may cost.

        To first order, all others refitted; the most needless first.
        """
        share, rows = self._independence(fit)
        named = range(fit.stated, len(fit.terms))
        inverse = invert(fit.restored(named).quadratic_model[0])
        offsets = {}
        for i, t in list(enumerate(fit.terms))[fit.stated :]:
            nominal = np.clip([p.nominal for p in t.parameters], t.low, t.high)
            if t.key not in needed:
                offsets[i] = fit.values[fit.slices[i]] - nominal
        prices = {i: self._price(fit, i, rows) for i in offsets}
        removed: list[int] = []
        least: list[float] = []
        spent = total = 0.0

        def cost_without(i: int) -> float:
            gone = [*removed, i]
            columns = np.concatenate([np.r_[fit.slices[k]] for k in gone]).astype(int)
            off = np.concatenate([offsets[k] for k in gone])
            block = invert(inverse[np.ix_(columns, columns)])
            return float(0.5 * off @ block @ off)

        while len(removed) < len(offsets):
            costs = {i: cost_without(i) for i in offsets if i not in removed}
            nets = {i: share * (c - spent) - prices[i] for i, c in costs.items()}
            i = min(nets, key=lambda k: nets[k])
            if nets[i] >= 0:
                break
            spent = costs[i]
            total += prices[i] / share
            removed.append(i)
            least.append(total)
        return removed, least


def _differentiate(fit: LinearFit, terms: Sequence[Term]) -> list[Direction]:
    """Directions of some terms beside a fit."""
    return [d for term in terms for d in propose_directions(fit, term)]
