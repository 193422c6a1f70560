// Makes the reset of a board. It is high for 32 cycles after the device is configured, and from when the button is pressed to 32
// cycles after it is let go, and it changes in step with the clock.
module reset_sync (
    input  logic clk,
    input  logic button,  // high: reset; may come at any time
    output logic reset
);
    logic [1:0] pressed = 0;  // two registers in a row, as the button may change at any time
    logic [5:0] count = 0;    // begins with 0 after configuration; bit 5: 32 cycles have passed
    assign reset = !count[5];
    always_ff @(posedge clk) begin
        pressed <= {pressed[0], button};
        if (pressed[1]) count <= 0;
        else if (reset) count <= count + 1;
    end
endmodule
