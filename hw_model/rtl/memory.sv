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
`ifdef MEMORY_BLOCK
    // Bits of a block of the device. A deep memory is sliced into a few bits each, so that a slice is one block: of wide blocks one
    // above the other, the choice between their words would be the slowest path.
    localparam integer MOST = `MEMORY_BLOCK / DEPTH > 1 ? `MEMORY_BLOCK / DEPTH : 1;
    localparam integer SLICE = MOST < 8 && MOST < WIDTH ? MOST : WIDTH;
    genvar low;
    generate
        for (low = 0; low < WIDTH; low = low + SLICE) begin : slices
            localparam integer BITS = WIDTH - low < SLICE ? WIDTH - low : SLICE;
            (* no_rw_check *) logic [BITS-1:0] words[0:DEPTH-1];
            always_ff @(posedge clk) begin
                if (write) words[write_address] <= write_data[low+:BITS];
                if (read) read_data[low+:BITS] <= words[read_address];
            end
        end
    endgenerate
`else
    // Without the attribute Yosys adds logic to each memory that makes such a word the old one.
    (* no_rw_check *) logic [WIDTH-1:0] words[0:DEPTH-1];

    always_ff @(posedge clk) begin
        if (write) words[write_address] <= write_data;
        if (read) read_data <= words[read_address];
    end
`endif
endmodule
