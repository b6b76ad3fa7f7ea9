"""The admissible window: the region of the parameters in which a model behaves as was measured."""
