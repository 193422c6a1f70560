// Charges on their way to compartments, a sum for each address: an operation (valid) adds the addend to one, or takes it, which
// reads and clears it. Ports and timing are those of accumulator.sv. Here the memory answers in the cycle in which it is asked, and
// shows in the next what is written: an operation reads, adds and writes within a cycle, and nothing has to be kept or forwarded.
module accumulator_at_once #(
    parameter integer WIDTH = 18,
    parameter integer DEPTH = 1024
) (
    input  logic                     clk,
    input  logic                     valid,
    input  logic                     take,
    input  logic [$clog2(DEPTH)-1:0] address,
    input  logic [WIDTH-1:0]         addend,
    output logic [WIDTH-1:0]         taken,  // two cycles after its operation, as in accumulator.sv
    input  logic                     sweep,  // clears sweep_address; never together with valid
    input  logic [$clog2(DEPTH)-1:0] sweep_address
);
    wire [$clog2(DEPTH)-1:0] at_address = sweep ? sweep_address : address;
    wire [WIDTH-1:0]         stored;
    logic [WIDTH-1:0]        taken1;
    logic                    take1;
    wire                     takes = valid && take;

    memory_at_once #(.WIDTH(WIDTH), .DEPTH(DEPTH)) charges (
        .clk,
        .write        (sweep || (valid && (!take || stored != 0))),  // to take a 0 needs no write
        .write_address(at_address),
        .write_data   (sweep || take ? {WIDTH{1'b0}} : stored + addend),
        .read         (valid),
        .read_address (at_address),
        .read_data    (stored)
    );

    always_ff @(posedge clk) begin
        take1 <= takes;
        if (takes) taken1 <= stored;
        if (take1) taken <= taken1;
    end
endmodule
