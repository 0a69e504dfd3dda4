"""Which way is up in a splat that does not say so."""

from phys4dgen.upright.guess import UpGuess, guess_up

__all__ = ["UpGuess", "guess_up"]
