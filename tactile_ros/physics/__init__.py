"""Physics of fields, elastomers and resistive sheets as functions of arrays."""
