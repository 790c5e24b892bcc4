"""The run over time, as the page shows it."""
