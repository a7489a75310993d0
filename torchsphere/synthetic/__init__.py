"""A ray caster and the demo's shot."""
