"""What a model is made of: parameters, laws, effects, and the contract of a simulator."""
