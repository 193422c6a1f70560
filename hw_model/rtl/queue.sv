// A first-in first-out queue of the compartments that fired in a step, by their numbers as sources, until their spikes are
// delivered. It has room for all compartments, so it is never full.
//
// The oldest number waits in the register `head`. Its successor takes its place two cycles after it was popped: one to read
// the memory, which answers late in its cycle, and one for the register.
module queue #(
    parameter integer WIDTH = 10,  // bits of the number of a source
    parameter integer DEPTH = 512  // compartments of the core
) (
    input  logic             clk,
    input  logic             clear,
    input  logic             push,
    input  logic [WIDTH-1:0] pushed,
    output logic             head_valid,  // `head` is the oldest one; pop it then
    output logic [WIDTH-1:0] head,
    input  logic             pop,
    output logic             empty        // nothing is queued, whether in the head or on its way there
);
    localparam integer PLACE = $clog2(DEPTH);

    logic [PLACE:0]   begin_at, end_at;  // one bit more than a place, which tells full from empty
    logic             coming;            // the memory shows the next head
    logic [WIDTH-1:0] oldest;
    // Whether the head is popped is known late in a cycle, so both outcomes are prepared and `pop` only chooses between them.
    wire  [PLACE:0]   behind = begin_at + 1'b1;
    wire  [PLACE:0]   next_begin = pop ? behind : begin_at;
    wire              read = pop ? behind != end_at : begin_at != end_at && !(head_valid || coming);
    assign empty = begin_at == end_at;

    memory #(.WIDTH(WIDTH), .DEPTH(DEPTH)) places (
        .clk,
        .write        (push),
        .write_address(end_at[PLACE-1:0]),
        .write_data   (pushed),
        .read,
        .read_address (next_begin[PLACE-1:0]),
        .read_data    (oldest)
    );

    always_ff @(posedge clk) begin
        if (coming) head <= oldest;
        if (clear) {begin_at, end_at, coming, head_valid} <= 0;
        else begin
            begin_at <= next_begin;
            if (push) end_at <= end_at + 1;
            coming <= read;
            head_valid <= coming || (head_valid && !pop);
        end
    end
endmodule
