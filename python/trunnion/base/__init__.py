"""Ground floor: exceptions, checks of arguments, units, reports, statistics. Knows no machine."""
