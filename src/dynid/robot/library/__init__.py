"""The built-in robots, one robot file each; every number has its source beside it."""
