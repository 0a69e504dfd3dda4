"""Segment Anything 2 over the rendered views as if they were a video, lifted to 3D (Paper: Sec. 3.2).

``segmenter`` declares what a network must do and ``network`` lets Transformers do it; all else is NumPy:
``view_path`` orders the views, ``proposals`` picks masks, ``tracks`` follows them, ``merging`` joins ids in 3D, and
``group`` puts them together. ``cost`` predicts the time.
"""
