"""Why it happened, what else could have: pure functions over recordings and maps, the same live and in replay."""
