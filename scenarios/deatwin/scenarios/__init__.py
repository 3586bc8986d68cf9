"""The scenarios of `deatwin scenario NAME`, each a study with plant, ident and control that ends in a page."""
