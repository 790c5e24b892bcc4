"""What compares images: the contract of a predictor by name, the choice among them, and those of the toolkit."""
