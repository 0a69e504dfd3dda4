"""The engine beside textbooks and experiments: ``python -m validation`` runs it all and writes docs/validation.md."""
