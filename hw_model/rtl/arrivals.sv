// Tells what an event means to the second phase, where that phase hears its events when they arrive (parameter LATER of
// locsnn_core.sv) instead of reading them from the buffer. A visit is the reading of one channel by the second phase; here
// are the same visits as in transpose.sv, one for each channel, with the channel as the address.
//
//     cycle 0   `mark`: an event of `mark_channel` was accepted; its visit is read
//     cycle 1   the memory answers
//     cycle 2   `shown`: step, first source and row go into registers
//     cycle 3   `valid`: `step` is the step in which the channel is visited, `source` the source of the event's row in this
//               visit; both stay until the next mark
module arrivals #(
    parameter integer VISITS = 128,  // visits that the memory holds
    parameter integer SOURCE = 11    // bits of the number of a source
) (
    input  logic              clk,
    input  logic              clear,
    input  logic              load_visit,
    input  logic [23:0]       load_address,
    input  logic [127:0]      load_data,
    input  logic [23:0]       kept,          // rows of a recording that the second phase hears
    input  logic              mark,          // an event of `mark_channel`
    input  logic [SOURCE-1:0] mark_channel,
    input  logic              mark_tick,     // the end of a row
    output logic              due,           // the second phase hears the row that arrives
    output logic              valid,
    output logic [15:0]       step,
    output logic [SOURCE-1:0] source
);
    localparam integer STEP = 16;
    localparam integer VISIT = STEP + 2 * SOURCE;  // bits of a visit, from bit 0: step, channel, source of the first row
    localparam integer INDEX = $clog2(VISITS);

    logic [23:0]       row;
    logic              looked, shown;        // a visit was asked for a cycle ago; the memory shows it
    logic [VISIT-1:0]  visit;
    // The source of the visit's first row, and the number of the event's row. They are added after these registers, because
    // the memory answers too late in its cycle for an addition.
    logic [SOURCE-1:0] first_source, source_offset;
    assign source = first_source + source_offset;

    memory #(.WIDTH(VISIT), .DEPTH(VISITS)) visits (
        .clk,
        .write(load_visit), .write_address(load_address[INDEX-1:0]), .write_data(load_data[VISIT-1:0]),
        .read(mark && due), .read_address(INDEX'(mark_channel)), .read_data(visit)
    );

    always_ff @(posedge clk) begin
        {looked, shown} <= clear ? 2'b0 : {mark && due, looked};
        if (shown) {step, first_source, source_offset} <= {visit[STEP-1:0], visit[STEP+SOURCE+:SOURCE], SOURCE'(row)};
        valid <= !mark && (shown || valid);
        due <= row != kept;  // no word comes in the cycle after a tick
        if (clear) row <= 0;
        else if (mark_tick && due) row <= row + 1;
    end

    wire unused = &{1'b0, load_address, load_data, mark_channel, visit};
endmodule
