// Stands in for memory.sv in proofs that hold whatever a memory contains: what it reads may be anything, and differ each time.
module memory #(
    parameter integer WIDTH = 8,
    parameter integer DEPTH = 16
) (
    input  logic                     clk,
    input  logic                     write,
    input  logic [$clog2(DEPTH)-1:0] write_address,
    input  logic [WIDTH-1:0]         write_data,
    input  logic                     read,
    input  logic [$clog2(DEPTH)-1:0] read_address,
    output logic [WIDTH-1:0]         read_data
);
    (* anyseq *) wire [WIDTH-1:0] anything;
    assign read_data = anything;
endmodule
