"""Probing an artefact with touches: plan, program, simulation, identification, observability."""
