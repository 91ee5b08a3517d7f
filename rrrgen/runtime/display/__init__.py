"""Display of models: HTML summaries for notebooks, drawings and animations of the arm."""
