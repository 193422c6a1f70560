// The charges under way, of every slot and compartment: add to one, or take one and leave 0, an operation per cycle.
//
//     cycle 0   the operation arrives, its address goes to the memory
//     cycle 1   the memory's word is captured, or the sum of an operation just before it (`forwarding`)
//     cycle 2   `taken` is the value; the sum, or 0 after a take, is written back
//
// A word that is written in a cycle can be read in the next, so operations one and two cycles old are forwarded.
module accumulator #(
    parameter integer WIDTH = 18,
    parameter integer DEPTH = 1024
) (
    input  logic                     clk,
    input  logic                     valid,
    input  logic                     take,
    input  logic [$clog2(DEPTH)-1:0] address,
    input  logic [WIDTH-1:0]         addend,
    output logic [WIDTH-1:0]         taken,
    // Between recordings every word is set to 0.
    input  logic                     sweep,
    input  logic [$clog2(DEPTH)-1:0] sweep_address
);
    logic                     valid1, valid2, valid3;
    logic                     take1, take2;
    logic [$clog2(DEPTH)-1:0] address1, address2, address3;
    logic [WIDTH-1:0]         addend1, addend2;
    logic [WIDTH-1:0]         value2, written3;
    logic [WIDTH-1:0]         stored;

    wire [WIDTH-1:0] written = take2 ? {WIDTH{1'b0}} : value2 + addend2;
    assign taken = value2;

    wire ticking;
    clock_gate gate (.clk, .enable(valid || valid1 || valid2 || valid3 || sweep), .gated(ticking));

    memory #(.WIDTH(WIDTH), .DEPTH(DEPTH)) charges (
        .clk(ticking),
        .write        ((valid2 && (!take2 || value2 != 0)) || sweep),  // what is 0 stays 0
        .write_address(sweep ? sweep_address : address2),
        .write_data   (sweep ? {WIDTH{1'b0}} : written),
        .read         (valid),
        .read_address (address),
        .read_data    (stored)
    );

    always_ff @(posedge ticking) begin
        {valid1, take1, address1, addend1} <= {valid, take, address, addend};
        {valid2, take2, address2, addend2} <= {valid1, take1, address1, addend1};
        {valid3, address3, written3} <= {valid2, address2, written};
        if (valid2 && address2 == address1) value2 <= written;
        else if (valid3 && address3 == address1) value2 <= written3;
        else value2 <= stored;
    end
endmodule
