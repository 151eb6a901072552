"""Mouse tools, one file each; `registry` lists them."""
