// Compartments that fired in a step, in order, until their spikes are delivered. It holds one of each.
module queue #(
    parameter integer WIDTH = 9,
    parameter integer DEPTH = 512
) (
    input  logic             clk,
    input  logic             clear,
    input  logic             push,
    input  logic [WIDTH-1:0] pushed,
    output logic             head_valid,
    output logic [WIDTH-1:0] head,
    input  logic             pop,
    output logic             empty
);
    localparam integer PLACE = $clog2(DEPTH);

    logic [PLACE:0] begin_at, end_at;  // one bit more than a place, which tells full from empty
    wire  [PLACE:0] next_begin = begin_at + {{PLACE{1'b0}}, pop};
    assign empty = begin_at == end_at;

    memory #(.WIDTH(WIDTH), .DEPTH(DEPTH)) places (
        .clk,
        .write        (push),
        .write_address(end_at[PLACE-1:0]),
        .write_data   (pushed),
        .read         (next_begin != end_at && (pop || !head_valid)),
        .read_address (next_begin[PLACE-1:0]),
        .read_data    (head)
    );

    always_ff @(posedge clk) begin
        if (clear) {begin_at, end_at, head_valid} <= 0;
        else begin
            begin_at <= next_begin;
            if (push) end_at <= end_at + 1;
            head_valid <= next_begin != end_at;
        end
    end
endmodule
