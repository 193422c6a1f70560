// A register for one word between two valid/ready handshakes, which cuts long paths: neither `ready` nor the data pass through
// in the same cycle. It is empty or full, so a word passes in every other cycle at most.
module one_word #(
    parameter integer WIDTH = 9  // bits of the word
) (
    input  logic             clk,
    input  logic             reset,
    input  logic             in_valid,
    output logic             in_ready,
    input  logic [WIDTH-1:0] in_data,
    output logic             out_valid,
    input  logic             out_ready,
    output logic [WIDTH-1:0] out_data
);
    assign in_ready = !out_valid;
    always_ff @(posedge clk) begin
        if (in_ready) {out_valid, out_data} <= {in_valid, in_data};
        else if (out_ready) out_valid <= 0;
        if (reset) out_valid <= 0;
    end
endmodule
