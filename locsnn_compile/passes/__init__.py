"""The compiler's passes from a float network to compartments: rounding (``quantize``) and lowering."""
