"""Compiled kernels: particle pass, grid pass, sorting, and the memory layout that they share."""
