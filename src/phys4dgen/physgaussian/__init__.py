"""Scenes of PhysGaussian (Xie et al., CVPR 2024) -> scenes of ours: its configuration file and its splat folder.

Every key and boundary type that it has, with its own spelling and defaults, is read and either carried over or named
among the differences. Facts are from its published source (commit 8339ed6); nothing of its text is used here.
"""
