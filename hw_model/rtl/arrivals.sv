// What an event is in the second phase, where that phase hears its events when they arrive: three cycles after its mark, the
// step in which its channel is visited, and the source that stands for its row in this visit. Visits are those of
// transpose.sv, one for each channel, in the order of the channels.
module arrivals #(
    parameter integer VISITS = 128,
    parameter integer SOURCE = 11
) (
    input  logic              clk,
    input  logic              clear,
    input  logic              load_visit,
    input  logic [23:0]       load_address,
    input  logic [127:0]      load_data,
    input  logic [23:0]       kept,          // rows of a recording that the second phase hears
    input  logic              mark,
    input  logic [SOURCE-1:0] mark_channel,
    input  logic              mark_tick,
    output logic              due,           // the second phase hears this row
    output logic              valid,
    output logic [15:0]       step,
    output logic [SOURCE-1:0] source
);
    localparam integer STEP = 16;
    localparam integer VISIT = STEP + 2 * SOURCE;
    localparam integer INDEX = $clog2(VISITS);

    logic [23:0]       row;
    logic              looked, shown;        // a visit was asked for a cycle ago; the memory shows it
    logic [VISIT-1:0]  visit;
    // The source of the visit's first row, and the number of the event's. They are added in the cycle that needs the sum:
    // memories answer late in a cycle.
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
