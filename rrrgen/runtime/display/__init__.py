"""What a model shows of itself: HTML for notebooks, pictures and animations."""
