"""What is built from the repository: the wheel and the documentation site."""
