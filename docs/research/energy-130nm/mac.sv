// An 8-bit multiply-accumulate unit, one product per cycle: what conventional networks are compared with. Rows of eight
// weights and of eight activations stay at the outputs of their memories for eight cycles; a sum of 32 bits stays here.
module mac (
    input  logic               clk,
    input  logic               clear,   // begins a new sum with the product that arrives three cycles later
    input  logic        [63:0] weights,
    input  logic        [63:0] activations,
    output logic signed [31:0] sum
);
    logic [2:0]         place;
    logic               clear1, clear2;
    logic signed [7:0]  weight;
    logic signed [7:0]  activation;
    logic signed [15:0] product;

    always_ff @(posedge clk) begin
        place <= clear ? 3'd0 : place + 3'd1;
        {clear1, clear2} <= {clear, clear1};
        weight <= weights[8*place+:8];
        activation <= activations[8*place+:8];
        product <= weight * activation;
        sum <= (clear2 ? 32'sd0 : sum) + {{16{product[15]}}, product};
    end
endmodule
