// What a step leaves of a register: rz(x, d) = sign(x) * ((|x| * (4096 - d)) >> 12), truncated toward zero.
//
// `keep` is 4096 - d. Three cycles: magnitude, product, sign.
module leak (
    input  logic               clk,
    input  logic signed [23:0] x,
    input  logic [12:0]        keep,
    output logic signed [23:0] left
);
    logic        negative1, negative2;
    logic [23:0] magnitude1;
    logic [12:0] keep1;
    logic [36:0] product2;

    always_ff @(posedge clk) begin
        {negative1, magnitude1, keep1} <= {x[23], x[23] ? -x : x, keep};
        {negative2, product2} <= {negative1, {13'b0, magnitude1} * {24'b0, keep1}};
    end
    wire signed [23:0] magnitude = product2[35:12];
    assign left = negative2 ? -magnitude : magnitude;

    wire unused = &{1'b0, product2[36], product2[11:0]};
endmodule
