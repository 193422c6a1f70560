// A memory of one write port and one read port. What is read appears in the next cycle, and stays until the next read.
// A word that is written in the same cycle in which it is read may come out old or new, depending on the device, so modules
// that use it forward the new word themselves or wait. Synthesis maps the array to block RAM.
//
// MEMORY_BLOCK, if it is defined, is the number of bits of a block RAM of the device; hw_model/rtl/board_sources.py says for which.
module memory #(
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
`ifdef MEMORY_BLOCK
    // A deep memory is cut into slices of a few bits each, so that a slice fills one block. Otherwise each of several blocks
    // would hold some of the words, and the choice between their outputs would be the slowest path of the core.
    // MOST is the width of a block at this depth. A memory for which it is 8 or more is shallow, and stays in one piece.
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
    // Without the attribute, Yosys adds logic to each memory that makes a word that is written while it is read the old one.
    (* no_rw_check *) logic [WIDTH-1:0] words[0:DEPTH-1];

    always_ff @(posedge clk) begin
        if (write) words[write_address] <= write_data;
        if (read) read_data <= words[read_address];
    end
`endif
endmodule
