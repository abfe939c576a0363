"""trunnion: the geometric accuracy of machine tools.

A model says what an instrument would read; an effect is a named group of parameters that changes
it; identification estimates parameters; diagnosis decides which effects the data demand;
compensation turns parameters into corrected commands.

The public names and where each lives stand in ``__init__.pyi``, in pipeline order. They are
imported when they are used, so that ``import trunnion`` costs next to nothing.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
