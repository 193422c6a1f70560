// The charges under way, of every slot and compartment: add to one, or take one and leave 0, an operation per cycle.
//
//     cycle 0   the operation arrives, its address goes to the memory
//     cycle 1   the memory answers, late in the cycle
//     cycle 2   `taken` is the value: the newest result of its address that is still on its way, or the memory's word
//     cycle 3   the sum, or 0 after a take, is written back
//
// A digit at the end of a name is this cycle. A charge is in units of 64, the lowest bits of a current.
//
// A word that is written in a cycle can be read in the next, so results of operations up to three cycles old are forwarded.
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
    // Between recordings every word is set to 0: taken, whatever it is.
    input  logic                     sweep,
    input  logic [$clog2(DEPTH)-1:0] sweep_address
);
    logic                     valid1, valid2, valid3, valid4;
    logic                     take1, take2, sweep1, sweep2, write3;
    logic [$clog2(DEPTH)-1:0] address1, address2, address3, address4;
    logic [WIDTH-1:0]         addend1, addend2;
    logic [WIDTH-1:0]         stored, kept2, written3, written4, written5;
    // Whether the operation of cycle 2 has the address of the one in cycle 3, 4 or 5, whose result it takes.
    logic                     as3, as4, as5;

    assign taken = as3 ? written3 : as4 ? written4 : as5 ? written5 : kept2;

    wire ticking;
    clock_gate gate (.clk, .enable(valid || valid1 || valid2 || valid3 || sweep), .gated(ticking));

    memory #(.WIDTH(WIDTH), .DEPTH(DEPTH)) charges (
        .clk(ticking),
        .write        (write3),
        .write_address(address3),
        .write_data   (written3),
        .read         (valid),
        .read_address (address),
        .read_data    (stored)
    );

    always_ff @(posedge ticking) begin
        {valid1, take1, sweep1, addend1} <= {valid || sweep, take || sweep, sweep, addend};
        {valid2, take2, sweep2, addend2} <= {valid1, take1, sweep1, addend1};
        {valid3, valid4} <= {valid2, valid3};
        address1 <= sweep ? sweep_address : address;
        {address2, address3, address4} <= {address1, address2, address3};
        kept2 <= stored;
        {as3, as4, as5} <= {valid2 && address2 == address1, valid3 && address3 == address1, valid4 && address4 == address1};
        written3 <= take2 ? {WIDTH{1'b0}} : taken + addend2;
        write3 <= valid2 && (!take2 || taken != 0 || sweep2);  // what is 0 stays 0
        {written4, written5} <= {written3, written4};
    end
endmodule
