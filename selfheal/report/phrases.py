"""Words of a diagnosis that no effect says of itself: of verdicts and comparisons."""

# what an effect's phrase may name beside its target and its parameters
COMMON = {"lacks": "that the model lacks", "other": "other than in the model"}
UNTOLD = (
    "These recordings cannot tell where it is wrong: too few readings lie inside, or "
    "outside, of each regime."
)
# of a verdict
MEANS = {
    "explained": "What the findings leave of short pieces is as large as noise.",
    "partly": "The findings help on recordings that the fit did not see, but what "
    "remains is not noise, and no further effect of the catalogue earns its place. "
    "Use the patched model where its error is small enough, and look at the map below "
    "for where the rest lies.",
    "unlisted": "The re-fitted model is wrong in a way that is no noise, yet no effect "
    "of the catalogue predicts recordings better that the fit did not see. The map "
    "below tells where to look.",
    "nothing": "After re-fitting what the model states, what remains on recordings "
    "that the fit did not see is as large as noise. That holds for motions like these; "
    "what was never excited cannot be seen, and stands under Remarks.",
}
