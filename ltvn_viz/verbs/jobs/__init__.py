"""The jobs of the page's verbs; they import plainly what they need, and `Verb.run` alone imports them."""
