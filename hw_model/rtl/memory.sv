// A memory of one write port and one read port. What is read appears in the next cycle, and stays until the next read.
// A word that is written while it is read comes out old or new, as the device likes: users forward or wait.
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
    // Without the attribute Yosys adds logic to each memory that makes such a word the old one.
    (* no_rw_check *) logic [WIDTH-1:0] words[0:DEPTH-1];

    always_ff @(posedge clk) begin
        if (write) words[write_address] <= write_data;
        if (read) read_data <= words[read_address];
    end
endmodule
