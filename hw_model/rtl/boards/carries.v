// Carry chains of an ECP5 in fewer logic cells. A CCU2C is two cells, one per bit. nextpnr-ecp5 adds two more where a carry
// enters a chain, even a constant one, and two wherever a carry is read from it. Here a chain begins with a cell that makes
// its first carry, and the carry that leaves it is read as one more sum. ecp5.mk applies these techmap rules during synthesis.

// Half 0 makes the carry, half i + 1 adds bit i, half Y_WIDTH + 1 adds 0 to the carry that leaves.
(* techmap_celltype = "$alu" *)
module carry_chain (A, B, CI, BI, X, Y, CO);
    parameter A_SIGNED = 0, B_SIGNED = 0, A_WIDTH = 1, B_WIDTH = 1, Y_WIDTH = 1;
    input  [A_WIDTH-1:0] A;
    input  [B_WIDTH-1:0] B;
    input                CI, BI;  // the first carry; whether B is inverted
    output [Y_WIDTH-1:0] X, Y, CO;

    // Chains of up to four bits are left to the rules of Yosys.
    wire _TECHMAP_FAIL_ = Y_WIDTH <= 4 || A_WIDTH == 0 || B_WIDTH == 0;

    localparam CELLS = (Y_WIDTH + 3) / 2, HALVES = 2 * CELLS;
    wire [Y_WIDTH-1:0] a = {{Y_WIDTH{A_SIGNED && A[A_WIDTH-1]}}, A};
    wire [Y_WIDTH-1:0] b = {{Y_WIDTH{B_SIGNED && B[B_WIDTH-1]}}, B};
    wire [HALVES-1:0]  left = {a, CI}, right = {{HALVES{BI}}, b, 1'b1}, sum;
    wire [CELLS:0]     carry;
    genvar i;
    generate for (i = 0; i < CELLS; i = i + 1) begin : cells
        // INIT is the truth table of a half. 000A: the carry is A0. 96AA: A + B or, where C (BI) is set, A + ~B.
        if (i == 0)
            CCU2C #(.INIT0(16'h000A), .INIT1(16'h96AA), .INJECT1_0("NO"), .INJECT1_1("NO")) pair (
                .A0(left[0]), .B0(1'b1), .C0(1'b1), .D0(1'b1), .S0(sum[0]),
                .A1(left[1]), .B1(right[1]), .C1(BI), .D1(1'b1), .S1(sum[1]), .COUT(carry[1])
            );
        else
            CCU2C #(.INIT0(16'h96AA), .INIT1(16'h96AA), .INJECT1_0("NO"), .INJECT1_1("NO")) pair (
                .A0(left[2*i]), .B0(right[2*i]), .C0(BI), .D0(1'b1), .S0(sum[2*i]),
                .A1(left[2*i+1]), .B1(right[2*i+1]), .C1(BI), .D1(1'b1), .S1(sum[2*i+1]),
                .CIN(carry[i]), .COUT(carry[i+1])
            );
    end endgenerate
    assign Y = sum[Y_WIDTH:1];
    assign X = a ^ b ^ {Y_WIDTH{BI}};
    // A carry within the chain follows from the sum that it went into: sum = a ^ b ^ carry.
    assign CO = {sum[Y_WIDTH+1], Y ^ X} >> 1;
endmodule

// The first cell of a chain needs no carry, and the last one's goes nowhere: nextpnr-ecp5 adds cells for them unless they are
// not connected at all. carries.ys finds these cells.
(* techmap_celltype = "CARRY_BEGIN" *)
module carry_begin (
    input CIN, A0, B0, C0, D0, A1, B1, C1, D1,
    output S0, S1, COUT
);
    parameter INIT0 = 16'h0000, INIT1 = 16'h0000, INJECT1_0 = "YES", INJECT1_1 = "YES";
    CCU2C #(.INIT0(INIT0), .INIT1(INIT1), .INJECT1_0(INJECT1_0), .INJECT1_1(INJECT1_1)) _TECHMAP_REPLACE_ (
        .CIN(1'bx), .A0, .B0, .C0, .D0, .A1, .B1, .C1, .D1, .S0, .S1, .COUT
    );
endmodule
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
