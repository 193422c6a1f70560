// What is known of a compartment before its state is read: whether the last step left anything in current and voltage, and
// whether the next step depends on its state. Where it does not, the memory of states need not be read, and was not written.
//
// Compartments are swept in order, and a word has two bits for each of eight. The word of the first of a sweep is not here in
// time: its state is read in any case. The word of the next eight is read with the last of eight.
module at_rest #(
    parameter integer COMPARTMENTS = 512
) (
    input  logic                            clk,
    input  logic                            issue,
    input  logic [$clog2(COMPARTMENTS)-1:0] number,
    output logic                            read,   // the state of `number`
    output logic                            kept,   // of the compartment that was issued a cycle ago
    output logic                            some,
    input  logic                            done,
    input  logic                            last,   // of its sweep
    input  logic [$clog2(COMPARTMENTS)-1:0] done_number,
    input  logic                            keeps,
    input  logic                            holds
);
    localparam integer NUMBER = $clog2(COMPARTMENTS);

    logic [15:0] shown, gathered, complete;
    logic        issued, unknown1;
    logic [2:0]  place1;
    logic [1:0]  known1;
    wire  [1:0]  known = shown[2*number[2:0]+:2];
    wire         unknown = issue && (!issued || (unknown1 && number[2:0] == 0));
    assign read = issue && (unknown || known[0]);
    assign {some, kept} = unknown1 ? shown[2*place1+:2] : known1;

    always_comb begin
        complete = gathered;
        complete[2*done_number[2:0]+:2] = {holds, keeps};
    end

    memory #(.WIDTH(16), .DEPTH(COMPARTMENTS / 8)) rests (
        .clk,
        .write        (done && (last || done_number[2:0] == 7)),
        .write_address(done_number[NUMBER-1:3]),
        .write_data   (complete),
        .read         (unknown || (issue && number[2:0] == 7)),
        .read_address (number[NUMBER-1:3] + (NUMBER - 3)'(!unknown)),
        .read_data    (shown)
    );

    always_ff @(posedge clk) begin
        {issued, unknown1, place1, known1} <= {issue, unknown, number[2:0], known};
        if (done) gathered <= complete;
    end
endmodule
