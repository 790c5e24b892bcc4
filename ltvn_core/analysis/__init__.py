"""Why did it do that? Pure functions over what happened: folds over the events of one run, and questions to its map.

Usable in a notebook with numpy and a recording alone; a network, where one is asked, comes in as a `Predictor`.
The page only shows what is found out here.
"""
