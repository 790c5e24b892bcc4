"""The jobs of the page's verbs. They import their dependencies at the top; only `Verb.run` imports them."""
