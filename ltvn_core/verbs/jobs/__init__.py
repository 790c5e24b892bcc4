"""The jobs of the verbs, one module each. They import all libraries that they need; only `Verb.run` imports them."""
