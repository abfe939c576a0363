"""An independent model of a touch measurement, to check the project's core against.

Plain numpy, written from the conventions alone; it shares no code with the core and none with the
package that calls it. ``forward`` says where ball and artefact are, ``contact`` finds the touch,
``generator`` makes measurements whose truth is known.
"""
