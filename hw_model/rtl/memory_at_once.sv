// A memory that shows a word in the same cycle in which it is read, as an array of latches does. A written word can be read in
// the next cycle. While nothing is read, the output is 0. accumulator_at_once.sv uses it.
module memory_at_once #(
    parameter integer WIDTH = 8,  // bits of a word
    parameter integer DEPTH = 16  // words
) (
    input  logic                     clk,
    input  logic                     write,
    input  logic [$clog2(DEPTH)-1:0] write_address,
    input  logic [WIDTH-1:0]         write_data,
    input  logic                     read,
    input  logic [$clog2(DEPTH)-1:0] read_address,
    output logic [WIDTH-1:0]         read_data
);
    logic [WIDTH-1:0] words[0:DEPTH-1];
    assign read_data = read ? words[read_address] : {WIDTH{1'b0}};

    always_ff @(posedge clk) if (write) words[write_address] <= write_data;
endmodule
