"""The stages of the pipeline: each turns core types into core types, one file per stage."""
