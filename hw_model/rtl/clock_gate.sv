// A clock that can be stopped while the registers that it drives have nothing to do, to save energy. Simulators and FPGAs
// take the clock as it is: every register that hangs on a gated clock may tick once more without changing a result. A chip
// puts the clock-gating cell of its library in place of this module.
module clock_gate (
    input  logic clk,
    input  logic enable,
    output logic gated
);
    assign gated = clk;

    wire unused = &{1'b0, enable};
endmodule
