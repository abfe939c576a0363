"""The models of each kind of data on the diagnosis engine; :mod:`.kinds` lists them."""
