// The last cell of a carry chain whose carry nobody reads: nextpnr-ecp5 adds two logic cells for the carry that leaves a chain,
// even where it goes nowhere, unless it is not connected at all. carry_ends.ys finds these cells.
(* techmap_celltype = "CARRY_END" *)
module carry_end (
    input CIN, A0, B0, C0, D0, A1, B1, C1, D1,
    output S0, S1, COUT
);
    parameter INIT0 = 16'h0000, INIT1 = 16'h0000, INJECT1_0 = "YES", INJECT1_1 = "YES";
    CCU2C #(.INIT0(INIT0), .INIT1(INIT1), .INJECT1_0(INJECT1_0), .INJECT1_1(INJECT1_1)) _TECHMAP_REPLACE_ (
        .CIN, .A0, .B0, .C0, .D0, .A1, .B1, .C1, .D1, .S0, .S1, .COUT(1'bx)
    );
endmodule
