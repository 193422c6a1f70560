// Stands in for memory.sv in the proof of the accumulator: a memory of which one word is known, at an address that the solver may
// choose. All other words read as anything, and so does this one in a cycle in which it is written.
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
    (* anyconst *) logic [$clog2(DEPTH)-1:0] watched;
    (* anyseq *) logic [WIDTH-1:0] anything;
    logic [WIDTH-1:0] word;
    wire written = write && write_address == watched;

    always_ff @(posedge clk) begin
        if (written) word <= write_data;
        if (read) read_data <= read_address == watched && !written ? word : anything;
    end
endmodule
