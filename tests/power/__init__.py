"""How often a diagnosis of touches is right: hidden effects, made by the twin, found by name."""
