"""The jobs that verbs do, one module each; they import plainly what they need, and `Verb.run` alone imports them."""
