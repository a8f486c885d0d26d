"""Large-scale space: experience, axioms, hypotheses, layout, and the questions one asks of them."""
