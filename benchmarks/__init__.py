"""The budgets of the architecture, measured: ratios and counts where a machine's noise would spoil a time."""
