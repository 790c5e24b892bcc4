"""Why it happened: folds over one recording or a live list of events, pure functions that a notebook can use."""
